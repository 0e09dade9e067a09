"""`riot exec` as a process: it becomes the command."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.control.segment_environment import export, write_session_files
from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess, riot

pytestmark = pytest.mark.integration

TELLS = """
import json, os, signal
told = {name: signal.getsignal(number) == signal.SIG_DFL for name, number in vars(signal).items() if name == "SIGXFSZ"}
print(json.dumps({"pid": os.getpid(), "config": os.environ["ZENOH_CONFIG"], **told}))
"""
SAYS = """
import zenoh
session = zenoh.open(zenoh.Config.from_env())
print(session.get("@riot/*/status").recv().ok.payload.to_string())
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setitem(ENVIRONMENT, "XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def test_a_program_uses_the_segment_of_the_router() -> None:
    with RouterProcess() as router:
        for segment, endpoint in router.endpoints.items():
            code, out, err = riot("exec", f"--segment={segment}={endpoint}", "--", sys.executable, "-c", SAYS)
            assert (code, err) == (0, "")
            assert json.loads(out)["result"]["segments"][segment]["components"]


def test_riot_finds_the_router_by_itself() -> None:
    with RouterProcess() as router:
        environment = export({name: [endpoint] for name, endpoint in router.endpoints.items()})
        code, out, _ = riot("exec", "--segment=unit", "--", *RIOT, "ctl", "status", environment=environment)
        assert (code, out.startswith("router router, ")) == (0, True)


def test_it_is_the_same_process_with_a_file_that_was_there_before(folder: Path) -> None:
    endpoints = {"unit": ["tcp/127.0.0.1:9"]}
    write_session_files(endpoints, folder)
    environment = {**ENVIRONMENT, **export(endpoints, files=folder)}
    command = [*RIOT, "exec", "--segment", "unit", sys.executable, "-c", TELLS]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True)
    out, _ = process.communicate(timeout=60)
    assert json.loads(out) == {"pid": process.pid, "config": str(folder / "zenoh-unit.json5"), "SIGXFSZ": False}


def test_arguments_streams_and_exit_status_are_the_commands() -> None:
    script = "import sys; print(sys.argv[1:], sys.stdin.read()); sys.exit(7)"
    command = [*RIOT, "exec", "--segment", "unit", "--", sys.executable, "-c", script, "--", "--segment", "x y"]
    done = subprocess.run(command, input="given", capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (7, "['--', '--segment', 'x y'] given\n", "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGPIPE])
def test_signals_are_the_commands(number: signal.Signals) -> None:
    command = [*RIOT, "exec", "--segment", "unit", "sh", "-c", "echo ready; exec sleep 60"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, env=ENVIRONMENT, text=True)
    assert process.stdout is not None
    with process, process.stdout:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert process.wait(60) == -number


def test_what_cannot_be_executed() -> None:
    code, _, err = riot("exec", "--segment", "unit", "--", "./no-such-program")
    assert (code, err) == (4, "riot: './no-such-program' cannot be executed: No such file or directory\n")
    code, _, err = riot("exec", "--segment", "unti", "--", "true")
    assert (code, "did you mean 'unit'?" in err) == (2, True)
