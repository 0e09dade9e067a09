"""A forked component cannot be told from one whose command was executed; where it could, nothing is forked."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.processes.starts import fork_of
from riot_bus.zenoh.session import wait_until

WAIT_S = 60.0
IMPORTS = ("json", "json.decoder", "numpy", "riot_bus.vocabulary.errors", "own", "nowhere.to.be.found")

PROGRAM = """
import atexit, json, os, signal, sys, threading
import own

def report():
    main = sys.modules["__main__"]
    print(json.dumps({
        "argv": sys.argv, "orig_argv": sys.orig_argv, "path": sys.path[0], "name": __name__, "file": __file__,
        "spec": getattr(__spec__, "name", None), "package": __package__, "main": main.__dict__ is globals(),
        "names": sorted(name for name in globals() if not name.startswith("__")),
        "cwd": os.getcwd(), "env": sorted(os.environ.items()), "stdin": sys.stdin.read(),
        "session": os.getsid(0) == os.getpid(),
        "parent": os.getppid(), "flags": str(sys.flags), "threads": threading.active_count(),
        "signals": [str(signal.getsignal(n)) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD)],
        "files": sorted(os.listdir("/proc/self/fd"))[:3], "imported": own.times,
    }))

atexit.register(print, "at exit")
report()
def last():
    threading.main_thread().join()
    print("last thread")
threading.Thread(target=last).start()
def inner(how):
    exec(how)
inner(sys.argv[-1])
"""


@pytest.fixture
def launcher() -> Iterator[Launcher]:
    with Launcher() as launcher:
        yield launcher


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "parts").mkdir()
    for place in (tmp_path / "parts" / "__main__.py", tmp_path / "parts" / "program.py", tmp_path / "program.py"):
        place.write_text(PROGRAM)
    for place in (tmp_path / "own.py", tmp_path / "parts" / "own.py"):
        place.write_text("times = globals().get('times', 0) + 1\n")
    return tmp_path


def start(
    launcher: Launcher, folder: Path, words: Sequence[str], *, modules: Sequence[str], name: str = "unit"
) -> ComponentProcess:
    env = {**os.environ, "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"}
    argv = [sys.executable, *words]
    fork = fork_of(argv, env=env, varying=frozenset({"RUN"}), cwd=folder, modules=modules)
    env |= {"RUN": name}
    return launcher.start(name, argv, env=env, cwd=folder, directory=folder, fork=fork)


def ended(launcher: Launcher, process: ComponentProcess) -> tuple[str, str, int | None]:
    assert launcher.wait([process], timeout=WAIT_S)
    return process.printed(), process.errors(), process.status


THREAD = "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start()"
ENDS = (
    "pass",
    "raise ValueError('bad')",
    "sys.exit(3)",
    "sys.exit('a text')",
    "raise SystemExit",
    "os._exit(4)",
    "os.kill(os.getpid(), signal.SIGKILL)",
    "import ctypes; ctypes.string_at(0)",
    "[][1]",
)


@pytest.mark.parametrize(
    "command", [("program.py",), ("-m", "parts"), ("-m", "parts.program"), ("-u", "-Wignore", "program.py")]
)
@pytest.mark.parametrize("end", ENDS)
def test_it_is_as_if_it_had_been_executed(launcher: Launcher, folder: Path, command: tuple[str, ...], end: str) -> None:
    words = [*command, "--name", "a b", end]
    executed = ended(launcher, start(launcher, folder, words, modules=(), name="executed"))
    forked = start(launcher, folder, words, modules=IMPORTS, name="executed2")
    assert forked.started == "forked"
    printed, errors, status = ended(launcher, forked)
    assert (printed.replace("executed2", "executed"), errors, status) == executed


def test_a_script_that_names_its_interpreter_is_as_if_it_had_been_executed(launcher: Launcher, folder: Path) -> None:
    script = folder / "node"
    script.write_text(f"#!{sys.executable} -u\n{PROGRAM}")
    script.chmod(0o755)
    done = []
    for modules in ((), IMPORTS):
        env = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        fork = fork_of(["./node", "pass"], env=env, varying=frozenset(), cwd=folder, modules=modules)
        process = launcher.start("node", ["./node", "pass"], env=env, cwd=folder, directory=folder, fork=fork)
        done.append((process.started, *ended(launcher, process)))
        process.stdout.unlink()
    assert [each[0] for each in done] == ["executed", "forked"]
    assert done[0][1:] == done[1][1:]


def test_what_a_server_needs_goes_to_the_supervisor_once(
    launcher: Launcher, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[dict[str, Any]] = []
    send = launcher._send

    def note(request: dict[str, Any]) -> None:
        sent.append(request)
        send(request)

    monkeypatch.setattr(launcher, "_send", note)
    many = ("json", *(f"nowhere.module{number}" for number in range(1000)))
    for modules in (many, many, many[:-1], many):
        assert start(launcher, folder, ["program.py", "pass"], modules=modules).started == "forked"
    forks = [request["fork"] for request in sent if request["do"] == "start"]
    assert [fork["server"] for fork in forks] == [0, 0, 1, 0]
    assert ["wanted" in fork for fork in forks] == [True, False, True, False]
    assert len(json.dumps(forks[1])) < 1000


def test_it_has_imported_what_is_installed_and_nothing_of_its_own(launcher: Launcher, folder: Path) -> None:
    code = f"import sys; print([name in sys.modules for name in {IMPORTS[1:-1]}])"
    (folder / "looks.py").write_text(f"{code}\nimport numpy; print(numpy.random.random())")
    printed = []
    for number in range(2):
        process = start(launcher, folder, ["looks.py"], modules=IMPORTS, name=f"looks{number}")
        printed.append(ended(launcher, process)[0].splitlines())
    assert [lines[0] for lines in printed] == ["[True, True, True, False]"] * 2
    assert printed[0][1] != printed[1][1]  # processes do not draw the same numbers


def test_a_script_that_has_changed_is_compiled_again(launcher: Launcher, folder: Path) -> None:
    said = []
    for number, text in enumerate(("print(1)", "print(1)", "print(2)", "print(", "print(3)")):
        if not (folder / "says.py").exists() or (folder / "says.py").read_text() != text:
            (folder / "new.py").write_text(text)
            (folder / "new.py").replace(folder / "says.py")
        process = start(launcher, folder, ["says.py"], modules=IMPORTS, name=f"says{number}")
        printed, errors, _ = ended(launcher, process)
        said.append(printed.strip() or errors.strip().splitlines()[-1].partition(":")[0])
    assert said == ["1", "1", "2", "SyntaxError", "3"]


def test_it_is_killed_with_all_others(launcher: Launcher, folder: Path) -> None:
    (folder / "sleeps.py").write_text("import time; print('here', flush=True); time.sleep(600)")
    process = start(launcher, folder, ["sleeps.py"], modules=IMPORTS)
    assert wait_until(lambda: "here" in process.printed(), WAIT_S)
    assert launcher.alive(process)
    launcher.kill_all()
    assert not Path(f"/proc/{process.pid}").exists()
    again = start(launcher, folder, ["sleeps.py"], modules=IMPORTS, name="again")
    assert again.started == "forked"
    assert wait_until(lambda: "here" in again.printed(), WAIT_S)
    launcher.close()
    assert not Path(f"/proc/{again.pid}").exists()


@pytest.mark.parametrize(
    ("file", "text", "modules", "why"),
    [
        ("site-packages/busy.py", THREAD, "busy", "its imports start 1 threads"),
        ("site-packages/gevent.py", "", "gevent", "it imports gevent, which must come before all others"),
        ("json.py", "dumps = str", "json", r"it has modules of its own called .*json.*"),
        ("site-packages/dies.py", "import os; os._exit(1)", "dies", "the fork server has ended"),
    ],
)  # fmt: skip
def test_where_it_would_make_a_difference_it_is_executed(
    launcher: Launcher, folder: Path, monkeypatch: pytest.MonkeyPatch, file: str, text: str, modules: str, why: str
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(folder / "site-packages"))
    (folder / file).parent.mkdir(exist_ok=True)
    (folder / file).write_text(text)
    (folder / "simple.py").write_text("print('done')")
    for number in range(2):
        process = start(launcher, folder, ["simple.py"], modules=[modules], name=f"simple{number}")
        assert re.fullmatch(f"executed, since {why}", process.started)
        assert ended(launcher, process) == ("done\n", "", 0)
