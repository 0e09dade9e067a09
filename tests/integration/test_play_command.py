"""`riot play` and `riot ctl play`, as people use them."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import subprocess
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.play_tools import BEGIN, MS, SECOND, Listener, numbered, write
from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess, riot
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration


@pytest.fixture
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@contextlib.contextmanager
def playing(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A player that has begun."""
    process = subprocess.Popen(
        [*RIOT, "play", "--format=json", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    assert process.stdout is not None
    try:
        assert json.loads(process.stdout.readline())["event"] == "started"
        yield process
    finally:
        process.kill()
        process.communicate(timeout=60)


def ended(process: subprocess.Popen[str]) -> tuple[int, dict[str, Any], str]:
    out, err = process.communicate(timeout=60)
    return process.returncode, json.loads(out), err


def test_play_through_a_router_with_interception(tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(500, "cut/x", "free", period=2 * MS))
    with RouterProcess("--intercept=cut/**") as router, Puppet(router.endpoints["unit"]) as sink:
        sink.do("subscribe", key="*/x")
        sink.do("subscribe", key="free")
        code, out, err = riot("play", str(log), "-e", router.endpoints["system"], "--wait=20")
        assert (code, err) == (0, "")
        found = [bytes.fromhex(each["payload"]) for each in sink.do("wait", count=500)]
    assert sorted(found) == sorted(b'{"v": %d}' % number for number in range(500))
    first, last = out.splitlines()
    assert first == f"player: 2 topics of {log}, 0.5 s, 1x, to {router.endpoints['system']}"
    assert last.startswith("played 500 messages in 0.")
    assert "late by" in last


def test_remote_control(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x", period=10 * SECOND))

    def ctl(*arguments: str) -> dict[str, Any]:
        code, out, err = riot("ctl", "play", *arguments, "-e", router, "--format=json")
        assert code == 0, err
        found: dict[str, Any] = json.loads(out)
        return found

    with Listener(router, "a/*") as listener, playing(str(log), "-e", router, "--name=one", "-p") as process:
        assert wait_until(lambda: ctl("status")["state"] == "paused", 60)
        ctl("step")
        assert ctl("step", "2")["state"] == "paused"
        assert len(listener.wait(3)) == 3
        assert ctl("seek", "55")["position"] == 55.0
        assert ctl("rate", "0.001", "--player=one")["rate"] == 0.001
        assert ctl("resume")["state"] == "playing"
        assert ctl("pause")["state"] == "paused"
        assert len(listener.messages) == 3
        code, out, err = riot("ctl", "play", "status", "-e", router)
        assert (code, err) == (0, "")
        assert out.splitlines()[0] == f"player one, process {process.pid}: {log}"
        assert out.splitlines()[1].startswith("paused, 55.0 of 90.0 s, 0.001x, 3 messages")
        ctl("stop")
        code, result, err = ended(process)
    assert (code, err) == (0, "")
    assert (result["event"], result["published"], result["stopped"]) == ("ended", 3, True)


def test_control_of_nobody_and_with_nonsense(router: str, tmp_path: Path) -> None:
    code, _, err = riot("ctl", "play", "pause", "-e", router)
    assert code == 4
    assert "no riot player answers" in err
    log = write(tmp_path / "log.mcap", numbered(2, "a/x", period=100 * SECOND))
    with playing(str(log), "-e", router, "-p"):
        code, _, err = riot("ctl", "play", "rate", "1e9", "-e", router)
        assert (code, "not a speed" in err) == (2, True)
        code, _, err = riot("ctl", "play", "pause", "-e", router, "--player=other")
        assert (code, "no player 'other'" in err, "there are player" in err) == (4, True, True)
        code, _, err = riot("ctl", "status", "-e", router)
        assert (code, "no riot router answers" in err) == (4, True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_with_a_summary(router: str, tmp_path: Path, number: int) -> None:
    log = write(tmp_path / "log.mcap", numbered(100, "a/x", period=10 * SECOND))
    with Listener(router, "a/*") as listener, playing(str(log), "-e", router) as process:
        listener.wait(1)
        process.send_signal(number)
        code, result, err = ended(process)
    assert (code, err) == (130, "")
    assert (result["published"], result["stopped"]) == (1, True)


def test_a_damaged_log_is_played_as_far_as_it_goes(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(1000, "a/x", period=1000))
    log.write_bytes(log.read_bytes()[:-400])
    with Listener(router, "a/*") as listener:
        code, out, err = riot("play", str(log), "-e", router, "-r", "0", "--wait=20")
        assert listener.payloads(1000) == [b'{"v": %d}' % number for number in range(1000)]
    assert code == 3
    assert out.splitlines()[1].startswith("played 1000 messages")
    assert "the file was not closed" in err


def test_errors_before_it_begins(tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x"))
    for arguments, expected, text in (
        ([str(log), "-e", "tcp/127.0.0.1:1"], 4, "nobody answers"),
        ([str(tmp_path / "none.mcap")], 2, "cannot read the log"),
        ([__file__], 2, "not an MCAP file"),
        ([str(log), "--topics=b"], 2, "no topic 'b'"),
        ([str(log), "--rate=fast"], 2, "--rate"),
        ([str(log), "--cfg=nonsense"], 2, "not a Zenoh setting"),
    ):
        code, out, err = riot("play", *arguments)
        assert (code, out) == (expected, "")
        assert text in err
        assert "Traceback" not in err


class Terminal:
    """A pseudo-terminal with a player on it."""

    def __init__(self, *arguments: str) -> None:
        self.master, self._slave = pty.openpty()
        self.before = termios.tcgetattr(self._slave)
        self.process = subprocess.Popen(
            [*RIOT, "play", *arguments],
            stdin=self._slave,
            stdout=self._slave,
            stderr=self._slave,
            env={**ENVIRONMENT, "TERM": "xterm"},
            preexec_fn=self._lead,
        )
        self.shown = ""

    def _lead(self) -> None:
        os.setsid()
        import fcntl

        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    def press(self, text: str) -> None:
        os.write(self.master, text.encode())

    def shows(self, text: str, timeout: float = 30) -> bool:
        """Wait until something is shown after what was waited for before."""
        deadline = time.monotonic() + timeout
        while text not in self.shown and time.monotonic() < deadline:
            if select.select([self.master], [], [], 0.1)[0]:
                self.shown += os.read(self.master, 4096).decode()
        found = text in self.shown
        self.shown = self.shown.partition(text)[2]
        return found

    def after(self) -> list[Any]:
        return termios.tcgetattr(self._slave)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.wait(60)
        os.close(self.master)
        os.close(self._slave)


def test_keys_on_a_terminal(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(100, "a/x", period=10 * SECOND))
    with Listener(router, "a/*") as listener, Terminal(str(log), "-e", router) as terminal:
        assert terminal.shows("playing, ")
        terminal.press(" ")
        assert terminal.shows("paused")
        terminal.press("s\x1b[C")
        assert terminal.shows("3 messages")
        terminal.press("]")
        assert terminal.shows("30.0 of")
        terminal.press("\x1b[A")
        assert terminal.shows("1.1x")
        terminal.press("-")
        assert terminal.shows(" 1x")
        terminal.press("0")
        assert terminal.shows("0.0 of")
        assert terminal.after()[3] & termios.ICANON == 0
        terminal.press("q")
        assert terminal.shows("stopped before the end")
        assert terminal.process.wait(60) == 0
        assert terminal.after() == terminal.before
        assert len(listener.messages) == 3


def test_ctrl_c_leaves_the_terminal_as_it_was(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(2, "a/x", period=100 * SECOND))
    with Terminal(str(log), "-e", router) as terminal:
        assert terminal.shows("of 100.0 s")
        terminal.press("\x03")
        assert terminal.shows("stopped before the end")
        assert terminal.process.wait(60) == 130
        assert terminal.after() == terminal.before


def test_begins_where_the_logs_begin_whatever_is_selected(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", [*numbered(1, "a/x"), *numbered(1, "a/y", begin=BEGIN + 1000 * SECOND)])
    with Listener(router, "a/*"), playing(str(log), "-e", router, "--topics=a/y", "--start-offset=999.9") as process:
        code, result, _ = ended(process)
    assert (code, result["published"]) == (0, 1)
    assert result["seconds"] < 20


HANGING = """
import time

class Hanging:
    def message(self, event):
        time.sleep(3600)
"""


def test_a_second_signal_ends_it_even_if_an_interceptor_hangs(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(10, "a/x"))
    (tmp_path / "hanging.py").write_text(HANGING)
    with playing(str(log), "-e", router, "--wait=0", f"--interceptor={tmp_path / 'hanging.py'}") as process:

        def over() -> bool:
            process.send_signal(signal.SIGINT)
            return process.poll() is not None

        assert wait_until(over, 60, interval=0.3)
        assert process.returncode in (130, -signal.SIGINT)  # one of them may come when Python has ended already


def test_a_folder_of_files_is_played_as_one(router: str, tmp_path: Path) -> None:
    for number in range(12):
        write(tmp_path / f"run_{number}.mcap", numbered(5, "a/x", begin=BEGIN + 5 * number * MS))
    with Listener(router, "a/*") as listener:
        code, out, err = riot("play", str(tmp_path), "-e", router, "--wait=20")
        assert (code, err) == (0, "")
        assert listener.payloads(60) == [b'{"v": %d}' % (number % 5) for number in range(60)]
    assert out.startswith(f"player: 1 topics of {tmp_path}, 0.1 s")


def test_names_in_a_log_do_nothing_to_a_terminal(router: str, tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap", numbered(1, "a/\x1b[31mx"))
    code, out, err = riot("play", str(log), "-e", router, "--wait=0.05")
    assert code == 0
    assert "there is no subscriber to a/\\x1b[31mx" in err
    assert "\x1b" not in out + err
