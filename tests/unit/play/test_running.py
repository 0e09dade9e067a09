"""What `riot play` says while it runs and at its end; the service is a double."""

from __future__ import annotations

import gc
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.control.terminal import Foreground
from riot_bus.play import running
from riot_bus.play.options import PlayOptions
from riot_bus.play.running import run_play
from riot_bus.play.service import PlayResult
from riot_bus.vocabulary.errors import DataLossError, EnvironmentFaultError

OPTIONS = PlayOptions(logs=[Path("a\x1b.mcap"), Path("b.mcap")], endpoint="tls/user:secret@x:1", rate=2.0)
LATE = {"p50": 0.0, "p99": 0.0, "max": 0.0}


class Service:
    """A player that has the result of a test."""

    def __init__(self, result: PlayResult, *, problem: Exception | None = None, interrupted: Any = None) -> None:
        self.name, self.ended, self.calls = "one", result, []
        self.problem, self.interrupted = problem, interrupted
        errors = {"mine": SimpleNamespace(count=2, first="Traceback")}
        self.programme = SimpleNamespace(
            cast=SimpleNamespace(names={"k/b": "/b", "k/a": "/a"}), pipeline=SimpleNamespace(errors=errors), hint="look"
        )

    def __call__(self, options: PlayOptions, *, warn: Any) -> Service:
        self.options = options
        warn("a rival\x1b")
        return self

    def __enter__(self) -> Service:
        if self.problem is not None:
            raise self.problem
        return self

    def __exit__(self, *error: object) -> None:
        self.calls.append("exit")

    def status(self) -> dict[str, Any]:
        return {"start": 1.0, "end": 3.5}

    def wait(self, seconds: float) -> bool:
        assert sys.getswitchinterval() < 1e-3
        assert gc.get_freeze_count() > 0
        if self.interrupted is not None:
            self.interrupted()
        return True

    def stop(self) -> None:
        self.calls.append("stop")

    def step(self) -> None:
        self.calls.append("step")

    def result(self) -> PlayResult:
        return self.ended

    def close(self) -> None:
        self.calls.append("close")


class Run:
    """A run in the foreground, and what it printed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, service: Service) -> None:
        self.said: list[str] = []
        self.warned: list[str] = []
        self.service = service
        monkeypatch.setattr(running, "PlayService", service)

    def __call__(self, *, as_json: bool = False) -> bool:
        return run_play(OPTIONS, Foreground(self.said.append, self.warned.append, as_json=as_json))


def test_a_run_tells_what_it_plays_and_what_came_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch, Service(PlayResult(published=3, seconds=1.0, lateness=LATE)))
    assert run()
    assert run.said == [
        "one: 2 topics of a\\x1b.mcap, b.mcap, 2.5 s, 2x, to tls/...@x:1",
        "played 3 messages in 1.00 s",
    ]
    assert run.warned[0] == "warning: a rival\\x1b"
    assert run.warned[1].startswith("interceptor mine raised 2 times")
    assert run.service.calls == ["exit", "close"]


def test_events_name_topics_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch, Service(PlayResult(lateness=LATE)))
    run(as_json=True)
    assert '"topics": ["/a", "/b"]' in run.said[0]
    assert [line.partition('"event": ')[2][:9].strip('", ') for line in run.said] == ["started", "ended"]


def test_all_that_was_lost_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    result = PlayResult(
        lateness=LATE,
        lost=Counter({"/a": 1, "/b": 3}),
        problems={"/c": "no type\x1b"},
        unread={"a.mcap": "2 chunks are damaged"},
    )
    run = Run(monkeypatch, Service(result))
    with pytest.raises(DataLossError) as caught:
        run()
    assert caught.value.message == (
        "a.mcap: 2 chunks are damaged; 4 messages were not published: /b 3, /a 1; /c: no type\\x1b"
    )
    assert caught.value.hint == "look"


def test_the_service_is_closed_if_it_cannot_start(monkeypatch: pytest.MonkeyPatch) -> None:
    before = sys.getswitchinterval()
    run = Run(monkeypatch, Service(PlayResult(), problem=EnvironmentFaultError("no router")))
    with pytest.raises(EnvironmentFaultError):
        run()
    assert run.service.calls == ["close"]
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0


def test_a_signal_stops_the_player_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    ends: list[Any] = []

    class Signals:
        def __init__(self, end: Any) -> None:
            ends.append(end)

        def __enter__(self) -> None:
            pass

        def __exit__(self, *error: object) -> None:
            pass

    monkeypatch.setattr(running, "ended_by_signals", Signals)
    run = Run(monkeypatch, Service(PlayResult(lateness=LATE), interrupted=lambda: ends[0]()))
    assert not run()
    assert run.service.calls == ["stop", "exit", "close"]
