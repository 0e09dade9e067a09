"""A component is ready when it says so: real processes on a real bus."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from riot_bus.processes.launcher import Launcher
from riot_bus.trial.context import open_system
from riot_bus.trial.setup import TrialSetup
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.integration

PROGRAM = """
import json, socket, sys, time
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
subscriber = session.declare_subscriber("ask", lambda sample: None)
while sys.argv[2] == "never":
    time.sleep(1)
time.sleep(0.5)
server = socket.create_server(("127.0.0.1", int(sys.argv[3])))
for state in "inactive", "active":
    session.put("told", json.dumps({"state": state}))
print("now it is ready", flush=True)
time.sleep(3600)
"""


def setup_of(tmp_path: Path, launcher: Launcher, ready: str, when: str, port: int | str) -> TrialSetup:
    (tmp_path / "part.py").write_text(PROGRAM)
    path = tmp_path / "riot.toml"
    path.write_text(
        f'[components.part]\ncommand = ["{{python}}", "part.py", "{{endpoint}}", "{when}", "{port}"]\n'
        f'inputs = ["ask"]\nready = {{ {ready} }}\n'
    )
    return TrialSetup(open_system(path), launcher, tmp_path, segments=["system"])


READY = [
    'line = "it is ready"',
    'topic = "told"',
    "topic = \"told where state == 'active'\"",
    'port = "{free_port}"',
    "after = 0.7",
    'command = ["{python}", "-c", "import socket; socket.create_connection((\'127.0.0.1\', {free_port}))"]',
]


def test_a_component_gets_copies_of_files_with_its_placeholders(tmp_path: Path) -> None:
    (tmp_path / "conf").mkdir()
    (tmp_path / "conf/part.json5").write_text('{ connect: ["{endpoint}"], port: {free_port}, seed: {seed} }')
    (tmp_path / "part.json5").write_text("{segment}")
    path = tmp_path / "riot.toml"
    show = "import sys; print(*(open(each).read() for each in sys.argv[1:]), flush=True); input()"
    command = f"'{{python}}', '-c', '{show}', '{{file:conf/part.json5}}', '{{file:part.json5}}'"
    path.write_text(f"[components.part]\ncommand = [{command}]\n")
    folder = tmp_path / "trial"
    folder.mkdir()
    with Launcher() as launcher, TrialSetup(open_system(path), launcher, folder, segments=["system"]) as one:
        process = one.start("part", seed=5)
        assert wait_until(lambda: "\n" in process.printed(), 60)
        endpoint, port = one.network.bus.endpoint("system"), one.processes.placeholders.free_port("{free_port}")
    assert process.printed() == f'{{ connect: ["{endpoint}"], port: {port}, seed: 5 }} system\n'


@pytest.mark.parametrize("ready", READY)
def test_a_component_is_waited_for(tmp_path: Path, ready: str) -> None:
    with Launcher() as launcher, setup_of(tmp_path, launcher, f"timeout = 60, {ready}", "soon", "{free_port}") as one:
        begin = time.monotonic()
        process = one.start("part", seed=0)
        one.readiness.wait_subscribed("part", ["ask"])
        assert time.monotonic() - begin >= 0.5
        if "after" not in ready:
            assert wait_until(lambda: "ready" in process.printed(), 60)


@pytest.mark.parametrize(
    ("ready", "words"),
    [
        ('line = "it is ready"', "has not printed 'it is ready' within 5 s"),
        ('topic = "told"', "has not published on told within 5 s"),
        ("topic = \"told where state == 'active'\"", "has not published on told where state == 'active' within 5 s"),
        ("port = PORT", "does not listen on port"),
        ('command = ["{python}", "-c", "exit(3)"]', "is not ready: '.*python.*' ended with status 3 within 5 s"),
        ('command = ["{python}", "-c", "input()"]', "is not ready: '.*python.*' ended with status 1 within 5 s"),
        ('command = ["sleep", "60"]', "is not ready: 'sleep' has not ended within 5 s"),
    ],
)
def test_what_does_not_come_is_told_after_its_own_timeout(tmp_path: Path, ready: str, words: str) -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))  # nobody listens there, nor can another test
        port: int = held.getsockname()[1]
        text = f"timeout = 5, {ready.replace('PORT', str(port))}"
        with Launcher() as launcher, setup_of(tmp_path, launcher, text, "never", port) as one:
            one.start("part", seed=0)
            with pytest.raises(EnvironmentFaultError, match=words):
                one.readiness.wait_subscribed("part", ["ask"])


TELLS = """
import os, sys, time, socket
print(os.getcwd(), *sys.argv[1:], os.environ["DOMAIN"], os.environ["PORT"], os.environ["OTHER"], flush=True)
server = socket.create_server(("127.0.0.1", int(sys.argv[2])))
time.sleep(3600)
"""


def test_parameters_of_commands_are_nominal_unless_a_trial_sets_them(tmp_path: Path) -> None:
    (tmp_path / "part.py").write_text("import sys\nprint(*sys.argv[1:], flush=True)")
    path = tmp_path / "riot.toml"
    path.write_text(
        '[components.part]\ncommand = ["{python}", "part.py", "gain={param:gain}", "{param:on}", "{param:name}"]\n'
        "[external.parameters]\ngain = { nominal = 1.5, range = [0, 9] }\non = { nominal = true }\n"
        'name = { nominal = "a b", values = ["a b", "c"] }\n'
    )
    context, told = open_system(path), []
    for number, parameters in enumerate([{}, {"gain": -0.25, "on": False}]):
        directory = tmp_path / str(number)
        directory.mkdir()
        with (
            Launcher(0) as launcher,
            TrialSetup(context, launcher, directory, segments=["system"], parameters=parameters) as one,
        ):
            process = one.start("part", seed=0)
            assert launcher.wait([process], timeout=60)
            told.append(process.printed().strip())
    assert told == ["gain=1.5 true a b", "gain=-0.25 false a b"]


def test_parallel_trials_have_folders_domains_and_ports_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "part.py").write_text(TELLS)
    for slot in ("0", "1"):
        (tmp_path / f"work-{slot}").mkdir()
    path = tmp_path / "riot.toml"
    path.write_text(
        '[components.part]\ncommand = ["{python}", "../part.py", "{slot}", "{free_port:a}"]\ncwd = "work-{slot}"\n'
        'env = { DOMAIN = "{domain}", PORT = "{free_port:a}", OTHER = "{free_port}" }\n'
        'ready = { port = "{free_port:a}", timeout = 60 }\n'
    )
    context, ports, domains = open_system(path), set(), set()
    with ExitStack() as stack:
        for slot in (0, 1):
            directory = tmp_path / str(slot)
            directory.mkdir()
            launcher = stack.enter_context(Launcher(slot))
            one = stack.enter_context(TrialSetup(context, launcher, directory, segments=["system"]))
            process = one.start("part", seed=0)
            one.readiness.wait_subscribed("part", [])
            folder, said, port, domain, same, other = process.printed().split()
            assert (folder, said) == (str(tmp_path / f"work-{slot}"), str(slot))
            assert port == same
            ports |= {port, other}
            domains.add(int(domain))
    assert len(ports) == 4
    assert len(domains) == 2
    assert domains < set(range(1, 101))
