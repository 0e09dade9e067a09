from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest

from riot_bus.processes.starts import Fork, Start, fork_of, ssh_command, start_of
from riot_bus.system.system_file import Component, Container, RemoteHost
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session import wait_until

ENDPOINT = "tcp/127.0.0.1:41234"
ENDPOINT, THERE = "tcp/127.0.0.1:41234", "tcp/127.0.0.1:15001"
WAIT_S = 30.0


def start(component: Component, folder: Path) -> Start:
    argv = list(component.command)
    return start_of(
        component,
        "riot-12ab-planner",
        argv=argv,
        env={"A": "1"},
        endpoint=ENDPOINT,
        there=ENDPOINT,
        folder=folder,
        cwd=folder,
    )


def test_a_command_is_executed_as_it_is(tmp_path: Path) -> None:
    component = Component(command=("plan", "-v"), teardown=("tidy",))
    assert start(component, tmp_path) == Start(["plan", "-v"], ("tidy",))


def test_a_container_is_removed_before_anything_else_is_torn_down(tmp_path: Path) -> None:
    told = tmp_path / "told"
    tool = tmp_path / "engine"
    tool.write_text(f'#!/bin/sh\necho "$@" >> {told}\n')
    tool.chmod(0o755)
    teardown = ("sh", "-c", f"echo 'at last' >> {told}")
    made = start(Component(container=Container(image="box", engine=str(tool)), teardown=teardown), tmp_path)
    assert (made.engine, made.relayed, made.script, made.lost) == (str(tool), True, None, 125)
    assert made.container == "riot-12ab-planner"
    assert "--env=A" in made.argv
    subprocess.run(made.teardown, check=True)
    assert told.read_text() == f"kill {made.container}\nrm -f {made.container}\nat last\n"


def test_another_machine_is_told_by_a_standard_input_that_stays_open(tmp_path: Path) -> None:
    made = start(Component(command=("plan",), ssh=RemoteHost(host="robot"), cwd="work"), tmp_path)
    assert (made.argv[0], made.argv[-1], made.relayed, made.lost) == ("ssh", "sh", True, 255)
    assert made.script is not None
    assert "cd work && export A=1 && env plan" in made.script


def test_no_value_of_a_variable_is_on_a_command_line(tmp_path: Path) -> None:
    secret = {"API_TOKEN": "s3cret"}
    for kind in ({"container": Container(image="box", engine="docker")}, {"ssh": RemoteHost(host="robot")}):
        component = Component(command=("plan",), **kind)  # type: ignore[arg-type]
        around = {"endpoint": ENDPOINT, "there": ENDPOINT, "folder": tmp_path, "cwd": tmp_path}
        made = start_of(component, "one", argv=["plan"], env=secret, **around)  # type: ignore[arg-type]
        assert "s3cret" not in repr([made.argv, made.teardown])


def test_what_runs_already_is_found_by_its_port(tmp_path: Path) -> None:
    made = start(Component(attach="tcp/127.0.0.1:7447"), tmp_path)
    assert made.argv[:6] == [sys.executable, "-E", "-P", "-m", "riot_bus.processes.attached", "7447"]
    assert made.lost == 1


def command(*words: str, env: dict[str, str] | None = None, cwd: str = ".") -> tuple[list[str], str]:
    return ssh_command(
        RemoteHost(host="robot", options=("-p", "22")), ENDPOINT, THERE, command=words, env=env or {}, cwd=cwd
    )


def run(*words: str, env: dict[str, str] | None = None, cwd: str = ".") -> subprocess.Popen[str]:
    """Execute what the other machine would, in a session of its own as there."""
    pipe = subprocess.PIPE
    argv, script = command(*words, env=env, cwd=cwd)
    process = subprocess.Popen(["sh", "-c", argv[-1]], stdin=pipe, stdout=pipe, text=True, start_new_session=True)
    assert process.stdin is not None
    process.stdin.write(script)
    process.stdin.flush()
    return process


def ended(process: subprocess.Popen[str]) -> str:
    """Return what it prints to its end; until then, the connection stays."""
    assert process.stdin is not None
    assert process.stdout is not None
    with process.stdin, process.stdout:
        out = process.stdout.read()
        process.wait(WAIT_S)
    return out


def test_the_port_of_the_segment_leads_back() -> None:
    words, _ = command("plan")
    assert words[0] == "ssh"
    assert words[words.index("-R") + 1] == "127.0.0.1:15001:127.0.0.1:41234"
    assert words[-4:-1] == ["-p", "22", "robot"]
    assert "BatchMode=yes" in words
    with pytest.raises(ConfigError, match="ssh forwards TCP alone, and the segment listens at quic"):
        ssh_command(RemoteHost(host="robot"), "quic/127.0.0.1:1", THERE, command=["plan"], env={}, cwd=".")


def test_words_and_variables_arrive_as_they_are(tmp_path: Path) -> None:
    show = "import os, sys; print(sys.argv[1:], os.environ['NAME'], os.getcwd(), sys.stdin.read()); sys.exit(3)"
    words = ["a b", "$HOME", "'", '"']
    process = run(sys.executable, "-c", show, *words, env={"NAME": "it's\n$x"}, cwd=str(tmp_path))
    assert ended(process) == f"{words} it's\n$x {os.path.realpath(tmp_path)} \n"
    assert process.returncode == 3


def test_a_signal_is_told_as_shells_tell_it() -> None:
    process = run(sys.executable, "-c", f"import os; os.kill(os.getpid(), {int(signal.SIGSEGV)})")
    ended(process)
    assert process.returncode == 128 + signal.SIGSEGV


def test_all_of_it_is_killed_when_the_connection_ends(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    inner = f"trap '' HUP TERM; sleep 98.5 & echo $! > {shlex.quote(str(ready))}.part; "
    inner += f"mv {shlex.quote(str(ready))}.part {shlex.quote(str(ready))}; wait"
    process = run("sh", "-c", inner)
    assert wait_until(ready.exists, WAIT_S)
    child = int(ready.read_text())
    assert psutil.pid_exists(child)
    assert process.stdin is not None
    process.stdin.close()
    process.wait(WAIT_S)
    assert process.returncode == -signal.SIGKILL
    assert wait_until(lambda: not _runs(child), WAIT_S)
    assert process.stdout is not None
    process.stdout.close()


def _runs(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


ENTRY_POINT = """#!{interpreter}
import re
import sys
from my_nodes.main import main
if __name__ == '__main__':
    sys.exit(main())
"""


def forked(
    cwd: Path, *argv: str, varying: frozenset[str] = frozenset(), modules: Sequence[str] = ("json",), path: str = ""
) -> Fork | str:
    return fork_of(argv, env={"PATH": path}, varying=varying, cwd=cwd, modules=modules)


def write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


def test_only_python_programs_are_forked(tmp_path: Path) -> None:
    for words in (
        ("/usr/bin/python3.12", "-X", "dev", "-O", "node.py", "--x"),
        ("python", "-m", "node"),
        ("python", "-Wignore", "-W", "error", "-X", "dev", "node.py"),
    ):
        assert isinstance(forked(tmp_path, *words), Fork)
    (tmp_path / "folder").mkdir()
    (tmp_path / "archive").write_bytes(b"#!/usr/bin/python3\nPK\x03\x04\x00")
    for words in (
        ("python", "-c", "pass"),
        ("python", "node"),
        ("python", "folder"),
        ("python", "archive"),
        ("python",),
    ):
        assert forked(tmp_path, *words) == "its command is not a Python script or module"
    assert forked(tmp_path, "bash", "node.py") == "its command is not a Python script or module"
    varying = frozenset({"PYTHONPATH", "OTHER"})
    assert forked(tmp_path, "python", "node.py", varying=varying) == "PYTHONPATH differs from trial to trial"
    assert forked(tmp_path, "python", "node.py", modules=[]) == ""  # whether it is a Python program is not known yet


@pytest.mark.parametrize(
    ("first", "interpreter"),
    [
        ("#!/usr/bin/python3", ["/usr/bin/python3"]),
        ("#! /usr/bin/python3 -Es ", ["/usr/bin/python3", "-Es"]),
        ("#!/usr/bin/env python3", ["python3"]),
        ("#!/usr/bin/env -S python3 -u", ["python3", "-u"]),
        ("#!/usr/bin/env python3 -u", None),  # env looks for a program called so
        ("#!/usr/bin/env", None),
        ("#!/bin/sh", None),
        ("#!", None),
        ("import sys", None),
    ],
)
def test_scripts_that_name_their_interpreter(tmp_path: Path, first: str, interpreter: list[str] | None) -> None:
    write(tmp_path / "bin" / "node", f"{first}\nimport sys\n")
    for words in (("bin/node", "--x"), (str(tmp_path / "bin" / "node"), "--x")):
        fork = forked(tmp_path, *words)
        assert (list(fork.interpreter) if isinstance(fork, Fork) else None) == interpreter
        if isinstance(fork, Fork):
            assert (fork.module, list(fork.words), fork.own) == (None, list(words), str(tmp_path / "bin"))
    fork = forked(tmp_path, "node", path=str(tmp_path / "bin"))
    assert isinstance(fork, Fork) == (interpreter is not None)
    assert not isinstance(fork, Fork) or fork.words == [str(tmp_path / "bin" / "node")]
    (tmp_path / "bin" / "node").chmod(0o644)
    assert isinstance(forked(tmp_path, "bin/node"), str)  # it cannot be executed


def test_files_of_any_name_are_forked_if_they_are_text(tmp_path: Path) -> None:
    (tmp_path / "node").write_text("import json\n")
    fork = forked(tmp_path, "python", "node")
    assert isinstance(fork, Fork)
    assert fork.words == ("node",)


def test_what_an_installed_program_imports_itself_is_imported_by_each_process_anew(tmp_path: Path) -> None:
    write(tmp_path / "bin" / "node", ENTRY_POINT.format(interpreter=sys.executable))
    modules = ["numpy", "my_nodes", "my_nodes.main", "numpy.linalg", "my_nodes_too"]
    fork = forked(tmp_path, "bin/node", modules=modules)
    assert isinstance(fork, Fork)
    assert fork.modules == ["numpy", "numpy.linalg", "my_nodes_too"]
    write(tmp_path / "bin" / "node", "#!/usr/bin/python3\nload_entry_point('my-nodes==1', 'console_scripts', 'n')()\n")
    fork = forked(tmp_path, "bin/node", modules=modules)
    assert isinstance(fork, Fork)
    assert fork.modules == ["numpy", "numpy.linalg", "my_nodes_too"]
