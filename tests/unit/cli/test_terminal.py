"""Keys and progress on a pseudo-terminal, in a process that owns it."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import select
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.cli.terminal import Terminal, split_keys

OWNER = """
import json, sys
from riot_bus.cli.terminal import Terminal
assert Terminal.present()
with Terminal() as terminal:
    print("ready")
    while True:
        for key in terminal.keys(0.05):
            print(json.dumps(key))
            if key == "p":
                terminal.progress("a line of progress")
            if key == "l":
                terminal.progress("x" * 500)
            if key == "q":
                raise SystemExit
"""


@pytest.mark.parametrize(
    ("text", "keys", "rest"),
    [
        ("", [], ""),
        ("ab ", ["a", "b", " "], ""),
        ("\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"], ""),
        ("\x1bOA", ["up"], ""),
        ("a\x1b[1;5Cb", ["a", "right", "b"], ""),
        ("\x1b[5~\x1b[H\x1bOPq", ["q"], ""),
        ("a\x1b", ["a"], "\x1b"),
        ("\x1b[", [], "\x1b["),
        ("\x1b[1;", [], "\x1b[1;"),
        ("\x1bs", ["\x1b", "s"], ""),
        ("[", ["["], ""),
    ],
)
def test_keys_of_a_text(text, keys, rest):
    assert split_keys(text) == (keys, rest)


@given(st.lists(st.sampled_from(["a", "[", "O", "\x1b", "\x1b[A", "\x1bOB", "\x1b[3~", "\x1b[1;2D", "0", ";"])))
def test_a_text_may_come_in_any_parts(parts):
    whole, rest = split_keys("".join(parts))
    found, left = [], ""
    for part in "".join(parts):
        keys, left = split_keys(left + part)
        found += keys
    assert (found, left) == (whole, rest)


class Owner:
    """A process on a pseudo-terminal of its own."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, b"\x18\0\x3c\0\0\0\0\0")  # 24 lines, 60 columns
        self.before = termios.tcgetattr(self.slave)
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-c", OWNER],
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            preexec_fn=self._lead,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        self.shown = ""

    @staticmethod
    def _lead() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell's background job, as the tests may be, ignores it
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    def press(self, text: str) -> None:
        os.write(self.master, text.encode())

    def shows(self, text: str) -> bool:
        while text not in self.shown and select.select([self.master], [], [], 30)[0]:
            self.shown += os.read(self.master, 4096).decode()
        found = text in self.shown
        self.shown = self.shown.partition(text)[2]
        return found

    @property
    def reads_keys(self) -> bool:
        return not termios.tcgetattr(self.slave)[3] & termios.ICANON


@pytest.fixture
def owner() -> Iterator[Owner]:
    found = Owner()
    yield found
    found.process.kill()
    found.process.wait(20)
    os.close(found.master)
    os.close(found.slave)


def test_keys_are_read_as_they_are_pressed_and_the_terminal_is_left_as_it_was(owner):
    assert owner.shows("ready")
    owner.press("aé\x1b[A")  # a letter of two bytes that means nothing
    assert owner.shows(json.dumps("a"))
    assert owner.shows(json.dumps("up"))
    assert owner.reads_keys
    owner.press("q")
    assert owner.process.wait(20) == 0
    assert termios.tcgetattr(owner.slave) == owner.before


def test_progress_fits_into_a_line_and_is_taken_away(owner):
    assert owner.shows("ready")
    owner.press("p")
    assert owner.shows("\ra line of progress")
    owner.press("l")
    assert owner.shows("\r" + "x" * 59)
    owner.press("q")
    assert owner.shows("\r" + " " * 59 + "\r")
    assert "x" not in owner.shown


def test_ctrl_c_leaves_the_terminal_as_it_was(owner):
    assert owner.shows("ready")
    owner.press("a")
    assert owner.shows(json.dumps("a"))
    owner.press("\x03")
    assert owner.process.wait(20) == -signal.SIGINT
    assert termios.tcgetattr(owner.slave) == owner.before


def test_stopped_and_back(owner):
    assert owner.shows("ready")
    owner.press("a")
    assert owner.shows(json.dumps("a"))
    owner.process.send_signal(signal.SIGSTOP)  # nobody is there whose job it would be: Ctrl-Z itself has no effect
    assert os.waitid(os.P_PID, owner.process.pid, os.WSTOPPED | os.WNOWAIT).si_status == signal.SIGSTOP
    termios.tcsetattr(owner.slave, termios.TCSANOW, owner.before)  # as a shell does
    owner.process.send_signal(signal.SIGCONT)
    owner.press("b")
    assert owner.shows(json.dumps("b"))
    assert owner.reads_keys


def test_without_a_terminal(monkeypatch, capsys):
    assert not Terminal.present()
    monkeypatch.setattr(sys, "stdin", None)
    assert not Terminal.present()
