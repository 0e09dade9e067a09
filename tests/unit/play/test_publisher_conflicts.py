"""Others that publish what is played; Zenoh's session is a fake."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.graph.tokens import ADVANCED
from riot_bus.play import publisher_conflicts
from riot_bus.play.publisher_conflicts import PublisherConflicts
from riot_bus.types.registry import TypeRegistry


class Session:
    """A session that hears what a test says."""

    def __init__(self, *tokens: str) -> None:
        self.tokens = [SimpleNamespace(ok=SimpleNamespace(key_expr=token)) for token in tokens]
        self.info = SimpleNamespace(zid=lambda: "0f")
        self.heard: dict[str, Any] = {}
        self.closed: list[str] = []

    def liveliness(self) -> Any:
        return SimpleNamespace(get=self._get)

    def _get(self, expression: str, *, timeout: float) -> list[Any]:
        assert expression == ADVANCED
        return [SimpleNamespace(ok=None), *self.tokens]

    def declare_subscriber(self, key: str, take: Any, *, allowed_origin: object) -> Any:
        assert "REMOTE" in str(allowed_origin)  # else it would hear the player
        self.heard[key] = take
        return SimpleNamespace(undeclare=lambda: self.closed.append(key))


class Timer:
    """A timer that runs out when a test says so."""

    def __init__(self, seconds: float, run: Any) -> None:
        self.run, self.started, self.cancelled = run, 0, 0

    def start(self) -> None:
        self.started += 1

    def cancel(self) -> None:
        self.cancelled += 1


@pytest.fixture(autouse=True)
def _timers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publisher_conflicts.threading, "Timer", Timer)


def conflicts(session: Any) -> tuple[PublisherConflicts, list[tuple[str, str]]]:
    found: list[tuple[str, str]] = []
    looking = PublisherConflicts(session, ["a", "b"], TypeRegistry(), lambda *each: found.append(each))
    looking.look()
    return looking, found


def test_tokens_of_other_publishers_of_these_keys_count() -> None:
    tokens = ("a/@adv/pub/ff/1/_", "a/@adv/pub/ee/1/_", "b/@adv/sub/ff/1/_", "b/@adv/pub/0f/1/_", "c/@adv/pub/ff/1/_")
    assert conflicts(Session(*tokens))[1] == [("a", "session ff")]


def test_messages_of_others_count_once_per_key() -> None:
    session = Session("a/@adv/pub/ff/1/_")
    _, found = conflicts(session)
    assert set(session.heard) == {"a", "b"}
    for key in "abab":
        session.heard[key](SimpleNamespace(key_expr=key))
    assert found == [("a", "session ff"), ("b", "another publisher")]


def test_it_listens_until_its_time_is_up_or_it_is_closed() -> None:
    session = Session()
    looking, _ = conflicts(session)
    timer: Any = looking._timer
    assert (timer.started, timer.daemon, session.closed) == (1, True, [])
    timer.run()
    looking.close()
    assert session.closed == ["a", "b"]
