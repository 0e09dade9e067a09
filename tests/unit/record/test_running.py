from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.control.terminal import Foreground
from riot_bus.log.account import Account
from riot_bus.record import running as module
from riot_bus.record.rotating_sink import FileResult
from riot_bus.record.running import run_capture
from riot_bus.record.service import CaptureResult
from riot_bus.vocabulary.errors import DataLossError

OPTIONS = SimpleNamespace(ring_seconds=0.0, keys=["a", "b"], endpoint="tcp/127.0.0.1:7447#password=x")


class Service:
    """A recording that ends by itself, or that cannot start."""

    result_: CaptureResult
    fault: Exception | None = None
    calls: list[str]

    def __init__(self, options: Any, *, warn: Callable[[str], None]) -> None:
        self.options, self.name, self.paused = options, "recorder", False
        warn("careful\x1b[2J")

    def __enter__(self) -> Service:
        if self.fault is not None:
            raise self.fault
        return self

    def __exit__(self, *error: object) -> None:
        self.calls.append("exit")

    def pause(self) -> None:
        self.calls.append("pause")
        self.paused = True

    def resume(self) -> None:
        self.calls.append("resume")
        self.paused = False

    def cut(self) -> None:
        self.calls.append("cut")

    def stop(self) -> None:
        self.calls.append("stop")

    def status(self) -> dict[str, Any]:
        return {"file": "a.mcap"}

    def wait(self, seconds: float) -> bool:
        return "stop" in self.calls

    def close(self) -> None:
        self.calls.append("close")

    def result(self) -> CaptureResult:
        return self.result_


class Console:
    """A terminal on which these keys are pressed."""

    def __init__(self, keys: str) -> None:
        self.pressed = keys

    def __enter__(self) -> Console:
        return self

    def __exit__(self, *error: object) -> None: ...

    def keys(self, timeout: float) -> list[str]:
        return list(self.pressed)

    def progress(self, line: str) -> None: ...


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """A function that records with these keys and this result; returns what is said."""
    monkeypatch.setattr(module, "CaptureService", Service)
    monkeypatch.setattr(module, "progress_line", lambda status: "")
    monkeypatch.setattr(module, "roomy_heap", lambda: None)
    monkeypatch.setattr(Service, "calls", [], raising=False)

    def record(account: Account, keys: str = "q", **options: Any) -> list[str]:
        result = CaptureResult([FileResult("a.mcap", 1000, account)], account, 2.0)
        monkeypatch.setattr(Service, "result_", result, raising=False)
        said: list[str] = []
        terminal: Any = Console(keys)
        wanted: Any = SimpleNamespace(**(vars(OPTIONS) | options))
        run_capture(wanted, Foreground(said.append, said.append, console=terminal))
        return said

    return record


def test_it_says_what_is_recorded_where_without_secrets_and_then_the_result(run: Callable[..., list[str]]) -> None:
    said = run(Account({"/a": 9}))
    assert said[0] == "careful\\x1b[2J"
    assert said[1].startswith("recorder: a, b of tcp/127.0.0.1:7447")
    assert said[1].endswith(" to a.mcap")
    assert "password=x" not in said[1]
    assert said[2] == "space: pause, s: another file, q: end"
    assert said[3] == "recorded 9 messages of 1 topic in 2.0 s"


def test_a_ring_has_other_words(run: Callable[..., list[str]]) -> None:
    said = run(Account({"/a": 9}), ring_seconds=30.0)
    assert said[1].endswith(" to the last 30 s")
    assert "d: write the ring" in said[2]


def test_keys_pause_cut_and_end_it(run: Callable[..., list[str]]) -> None:
    run(Account({"/a": 9}), keys="  sdxq")
    assert Service.calls == ["pause", "resume", "cut", "cut", "stop", "exit", "close"]


def test_lost_messages_are_no_success(run: Callable[..., list[str]]) -> None:
    with pytest.raises(DataLossError, match=r"3 messages are lost \(disk: 2, queue: 1\)"):
        run(Account({"/a": 9}, {"disk": {"/a": 2}, "queue": {"/b": 1}}))


def test_what_cannot_start_is_closed(run: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Service, "fault", OSError("no router"))
    with pytest.raises(OSError, match="no router"):
        run(Account({}))
    assert Service.calls == ["close"]
