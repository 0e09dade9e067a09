"""Components that are not one process of riot's own, in trials of a whole system on a real bus."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from riot_bus.processes.activity import out_of_memory_kills
from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.trial.context import open_system
from riot_bus.trial.setup import TrialSetup
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.integration

WAIT_S = 60.0
PROGRAM = """
import json, os, sys, time
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("connect/timeout_ms", "-1")
config.insert_json5("connect/exit_on_failure", "false")
session = zenoh.open(config)

def answer(sample):
    if bytes(sample.payload) == b"die":
        os.kill(os.getpid(), 11)
    session.put("answer", bytes(sample.payload))

subscriber = session.declare_subscriber("ask", answer)
print("ready", os.environ.get("GAIN"), flush=True)
time.sleep(3600)
"""


def system(folder: Path, text: str) -> Path:
    (folder / "part.py").write_text(PROGRAM)
    path = folder / "riot.toml"
    path.write_text(f'[components.part]\ninputs = ["ask"]\noutputs = ["answer"]\n{text}')
    return path


@contextmanager
def setup_of(path: Path, launcher: Launcher | None = None) -> Iterator[TrialSetup]:
    folder = Path(tempfile.mkdtemp(prefix="trial-", dir=path.parent))
    with (
        launcher or Launcher() as one,
        TrialSetup(open_system(path), one, folder, segments=["system"], attach=["part"]) as made,
    ):
        yield made


def prints(process: ComponentProcess, text: str) -> bool:
    return wait_until(lambda: process.printed() == text, WAIT_S)


def is_gone(pid: int) -> bool:
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    return True


def test_what_is_set_up_before_each_start_and_torn_down_after_each_end(tmp_path: Path) -> None:
    path = system(
        tmp_path,
        'command = ["{python}", "part.py", "{endpoint}"]\nenv = { GAIN = "2" }\n'
        'setup = ["sh", "-c", "echo set up $GAIN {slot} >> told"]\n'
        'teardown = ["sh", "-c", "echo torn down $GAIN >> told"]\n',
    )
    for _ in range(2):
        with setup_of(path) as one:
            process = one.start("part", seed=0)
            one.readiness.wait_subscribed("part", ["ask"])
            assert prints(process, "ready 2\n")
    assert (tmp_path / "told").read_text() == "set up 2 0\ntorn down 2\n" * 2


@pytest.mark.parametrize(
    ("setup", "error", "words"),
    [
        ('["sh", "-c", "echo no disk >&2; exit 3"]', ConfigError, "part.setup: 'sh' ended with status 3.*no disk"),
        ('["sleep", "92.5"]', EnvironmentFaultError, "part.setup: 'sleep' has not ended within 1 s"),
        ('["no-such-program"]', EnvironmentFaultError, "no-such-program"),
    ],
)
def test_a_setup_that_fails_is_no_failure_of_the_component(
    tmp_path: Path, setup: str, error: type[RiotError], words: str
) -> None:
    path = system(tmp_path, f'command = ["true"]\nsetup = {setup}\nready = {{ timeout = 1 }}\n')
    with setup_of(path) as one, pytest.raises(error, match=f"(?s){words}"):
        one.start("part", seed=0)


def test_only_some_of_what_a_command_starts_belongs_to_a_component(tmp_path: Path) -> None:
    (tmp_path / "all.py").write_text(
        "import subprocess, sys\n"
        "parts = [subprocess.Popen([sys.executable, name, sys.argv[1]]) for name in ('part.py', 'other.py')]\n"
        "for each in parts:\n    each.wait()\n"
    )
    path = system(tmp_path, 'command = ["{python}", "all.py", "{endpoint}"]\nonly = "part"\n')
    (tmp_path / "other.py").write_text("open('other', 'w')")
    with setup_of(path) as one:
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        assert len(one.network.bus.segment("system").peers() - one.network.bus.ids) == 1
        names = {each.name() for each in psutil.Process(process.pid).children()}
        assert "sleep" in names  # stands for the other one
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("starts", "told"), [("True", "it started other"), ("False", "nothing by Python's subprocess")]
)
def test_only_what_is_never_started_is_told(tmp_path: Path, starts: str, told: str) -> None:
    (tmp_path / "all.py").write_text(
        "import subprocess, sys\n"
        f"other = subprocess.Popen([sys.executable, 'other.py']) if {starts} else None\n"
        "exec(open('part.py').read())\n"
    )
    path = system(tmp_path, 'command = ["{python}", "all.py", "{endpoint}"]\nonly = "prat"\n')
    with setup_of(path) as one:
        one.start("part", seed=0)
        with pytest.raises(ConfigError, match=f"(?s)nothing that 'part' has started is called 'prat'.*{told}"):
            one.readiness.wait_subscribed("part", ["ask"])


def test_a_component_that_runs_already(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        number: int = probe.getsockname()[1]
    path = system(tmp_path, f'attach = "tcp/127.0.0.1:{number}"\nready = {{ timeout = 60 }}\n')
    command = [sys.executable, str(tmp_path / "part.py"), f"tcp/127.0.0.1:{number}"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            with setup_of(path) as one:
                one.start("part", seed=0)
                one.readiness.wait_subscribed("part", ["ask"])
                assert one.observation.threads(["part"]).pids[1:] == (process.pid,)
                assert one.observation.settle(["part"], window=0.05, timeout=30)
                view = one.view(["part"], settled=True, waited=1.0)
                assert view.components[0].signs.ended == ""
            assert process.poll() is None  # what riot has not started it does not end
            with setup_of(path) as one:  # and it comes again by itself
                one.start("part", seed=0)
                one.readiness.wait_subscribed("part", ["ask"])
                process.kill()
                assert one.processes.wait(["part"], timeout=WAIT_S)
                view = one.view(["part"], settled=True, waited=1.0)
                assert view.components[0].signs.ended == "its process has ended"
        finally:
            process.kill()


IMAGE = f"riot-test-{os.getpid()}"


@pytest.fixture(scope="module")
def engine() -> Iterator[str]:
    """A program that runs containers here, with an image without a file: what it needs is mounted."""
    name = os.environ.get("RIOT_TEST_CONTAINER_ENGINE", "")
    if not name:
        pytest.skip("RIOT_TEST_CONTAINER_ENGINE (podman, docker) is not set: containers are NOT TESTED")
    empty = subprocess.run(["tar", "-c", "--files-from=/dev/null"], capture_output=True, check=True).stdout
    subprocess.run([name, "import", "-", IMAGE], input=empty, capture_output=True, check=True)
    yield name
    subprocess.run([name, "rmi", "-f", IMAGE], capture_output=True, check=True)


CONTAINER = """
ready = {{ timeout = 60 }}
env = {{ GAIN = "3" }}
command = ["{python}", "{folder}/part.py", "{{endpoint}}"]
container = {{ image = "{image}", engine = "{engine}", options = {options}{more} }}
"""


def containers(engine: str) -> str:
    """Return the containers of this worker's image."""

    def ask(*words: str) -> str:
        return subprocess.run([engine, *words], capture_output=True, text=True, check=True).stdout.strip()

    image = ask("image", "inspect", "--format", "{{.Id}}", IMAGE)
    return ask("ps", "--all", "--quiet", "--filter", f"ancestor={image}")


MOUNTED = [each for each in ("/usr", "/bin", "/lib", "/lib64") if os.path.exists(each)]


def volumes(folder: Path) -> list[str]:
    every = dict.fromkeys([*MOUNTED, str(folder), sys.prefix, sys.base_prefix])
    return [f"{each}:{each}:ro" for each in every if each == "/usr" or not each.startswith("/usr/")]


def boxed(folder: Path, engine: str) -> Path:
    options = [f"--volume={each}" for each in volumes(folder)]
    values = {"python": sys.executable, "folder": folder, "engine": engine, "image": IMAGE}
    return system(folder, CONTAINER.format(**values, options=options, more=""))


def test_a_component_in_a_container(tmp_path: Path, engine: str) -> None:
    path = boxed(tmp_path, engine)
    with setup_of(path) as one:
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        assert prints(process, "ready 3\n")
        assert len(one.observation.threads(["part"]).pids) >= 3  # the engine's, process 1, and the program
        assert containers(engine)
    assert not containers(engine)


def test_a_crash_in_a_container_has_its_signal(tmp_path: Path, engine: str) -> None:
    with setup_of(boxed(tmp_path, engine)) as one:
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        one.network.bus.put("system", Message(time.time_ns(), "ask", b"die"))
        assert one.processes.wait(["part"], timeout=WAIT_S)
        assert process.status == -signal.SIGSEGV


def test_a_component_in_a_container_is_asked_to_end(tmp_path: Path, engine: str) -> None:
    path = boxed(tmp_path, engine)
    path.write_text(f'{path.read_text()}stop = ["{engine}", "stop", "{{container}}"]\n')
    with setup_of(path) as one:
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        one.processes.end(["part"])
        assert process.status == -signal.SIGTERM
    assert not containers(engine)


@pytest.mark.parametrize("networks", [[], ["robot"]], ids=["no networks", "a network of its own"])
def test_a_component_in_a_service_of_a_compose_file(tmp_path: Path, engine: str, networks: list[str]) -> None:
    compose = [engine, "compose"] if os.path.basename(engine) == "docker" else [f"{engine}-compose"]
    if shutil.which(compose[0]) is None:
        pytest.skip(f"no {compose[0]}: services of compose files are NOT TESTED")
    service: dict[str, object] = {
        "image": IMAGE,
        "volumes": volumes(tmp_path),
        "depends_on": ["other"],
        "environment": {"GAIN": "9"},
    }
    services: dict[str, dict[str, object]] = {"part": service, "other": {"image": IMAGE, "command": ["/bin/false"]}}
    for each in services.values() if networks else ():
        each["networks"] = networks
    of_file = {"services": services, "networks": {name: dict[str, object]() for name in networks}}
    (tmp_path / "compose.yaml").write_text(json.dumps(of_file))
    values = {"python": sys.executable, "folder": tmp_path, "engine": engine, "image": IMAGE, "options": []}
    more = ', compose = "compose.yaml", service = "part"'
    with setup_of(system(tmp_path, CONTAINER.format(**values, more=more))) as one:
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        assert prints(process, "ready 3\n"), process.printed()
        (*_, inside) = one.observation.threads(["part"]).pids
        hosts = Path(f"/proc/{inside}/root/etc/hosts").read_text().splitlines()
        assert "127.0.0.1" in {line.split()[0] for line in hosts if "other" in line.split()}
        assert len(one.observation.threads(["part"]).pids) >= 3
    assert not containers(engine)
    if os.path.basename(engine) == "podman":
        pods = subprocess.run([engine, "pod", "ls", "--format={{.Name}}"], capture_output=True, text=True, check=True)
        assert f"pod_{tmp_path.name}" not in pods.stdout.split()


def test_nothing_of_a_container_is_left_when_riot_is_killed(tmp_path: Path, engine: str) -> None:
    path = boxed(tmp_path, engine)
    code = f"""
import time
from pathlib import Path
from riot_bus.processes.activity import out_of_memory_kills
from riot_bus.trial.context import open_system
from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.trial.setup import TrialSetup
path = Path({str(path)!r})
(path.parent / "trial").mkdir()
one = TrialSetup(open_system(path), Launcher(), path.parent / "trial", segments=["system"]).__enter__()
one.start("part", seed=0)
one.readiness.wait_subscribed("part", ["ask"])
print(one.observation.threads(["part"]).pids[-1], flush=True)
time.sleep(3600)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        inside = int(owner.stdout.readline())
        assert containers(engine)
        owner.kill()
    assert wait_until(lambda: is_gone(inside) and not containers(engine), WAIT_S, interval=0.2)


@pytest.fixture
def ssh(tmp_path: Path) -> Iterator[list[str]]:
    """Options for an ssh to this machine, through a server of its own."""
    server = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if server is None or shutil.which("ssh") is None or shutil.which("ssh-keygen") is None:
        pytest.skip("no OpenSSH server")
    for name in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / name)], check=True)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = tmp_path / "sshd_config"
    settings.write_text(
        f"Port {port}\nListenAddress 127.0.0.1\nHostKey {tmp_path}/host\nPidFile none\nStrictModes no\nUsePAM no\n"
        f"AuthorizedKeysFile {tmp_path}/user.pub\nPermitRootLogin prohibit-password\n"
    )
    if os.getuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # it separates its privileges there
    with subprocess.Popen([server, "-D", "-e", "-f", str(settings)], stderr=subprocess.DEVNULL) as process:
        try:
            options = ["-p", str(port), "-i", f"{tmp_path}/user", "-F", "none"]
            known = ["-o", "StrictHostKeyChecking=no", "-o", f"UserKnownHostsFile={tmp_path}/known"]
            reached = ["ssh", *options, *known, "-o", "BatchMode=yes", "127.0.0.1", "true"]
            if not wait_until(lambda: subprocess.run(reached, capture_output=True).returncode == 0, 30, interval=0.2):
                pytest.skip("the OpenSSH server lets nobody in here")
            yield [*options, *known]
        finally:
            process.terminate()


def remote(folder: Path, options: list[str], more: str = "") -> Path:
    text = f'command = ["{sys.executable}", "{folder}/part.py", "{{endpoint}}"]\nenv = {{ GAIN = "4" }}\n'
    text += f'ssh = {{ host = "127.0.0.1", options = {options} }}\nready = {{ timeout = 60 }}\n{more}'
    return system(folder, text)


def of_command(folder: Path) -> list[psutil.Process]:
    """Return the processes that execute the program of a folder, but for those that only hand it on."""
    found = []
    for each in psutil.process_iter(["cmdline"]):
        words = each.info["cmdline"] or [""]
        if f"{folder}/part.py" in words and words[0] == sys.executable:
            found.append(each)
    return found


def test_a_component_on_another_machine(tmp_path: Path, ssh: list[str]) -> None:
    path = remote(tmp_path, ssh)
    with setup_of(path) as one:
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        assert prints(process, "ready 4\n")
        (there,) = of_command(tmp_path)
        there.send_signal(signal.SIGSEGV)
        assert one.processes.wait(["part"], timeout=WAIT_S)
        assert process.status == -signal.SIGSEGV
        one.processes.end(["part"])
    with setup_of(path) as one:
        one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
    assert wait_until(lambda: not of_command(tmp_path), WAIT_S)


def test_a_component_on_another_machine_is_asked_to_end(tmp_path: Path, ssh: list[str]) -> None:
    told = ["ssh", *ssh, "127.0.0.1", "pkill", "-f", f"'^{sys.executable} {tmp_path}/part.py'"]
    with setup_of(remote(tmp_path, ssh, f"stop = {json.dumps(told)}\n")) as one:
        one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        one.processes.end(["part"])
        assert one.processes.started["part"].status == -signal.SIGTERM


def test_a_connection_that_is_lost_is_no_failure_of_the_component(tmp_path: Path, ssh: list[str]) -> None:
    path = remote(tmp_path, ["-p", "1", *ssh[2:]])
    begin = time.monotonic()
    with setup_of(path) as one:
        one.start("part", seed=0)
        with pytest.raises(EnvironmentFaultError, match="'ssh' of component 'part' ended with status"):
            one.readiness.wait_subscribed("part", ["ask"])
    assert time.monotonic() - begin < WAIT_S


def test_a_kill_for_want_of_memory_is_no_crash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with setup_of(system(tmp_path, 'command = ["{python}", "part.py", "{endpoint}"]')) as made:
        process = made.start("part", seed=0)
        os.kill(process.pid, signal.SIGKILL)
        assert made.processes.wait(["part"], timeout=WAIT_S)
        assert made.view(["part"], settled=True, waited=1.0).components[0].status == -signal.SIGKILL
        monkeypatch.setattr("riot_bus.trial.setup.out_of_memory_kills", lambda: out_of_memory_kills() + 1)
        with pytest.raises(EnvironmentFaultError, match="the machine has no memory left"):
            made.view(["part"], settled=True, waited=1.0)
