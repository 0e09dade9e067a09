from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.record.latched import LatchedCaches
from riot_bus.zenoh import libraries

LIBRARY = SimpleNamespace(
    QueryTarget=SimpleNamespace(ALL="all"),
    ConsolidationMode=SimpleNamespace(NONE="none"),
    ReplyKeyExpr=SimpleNamespace(ANY="any"),
)


def sample(key: str, *, kind: int = 0) -> Any:
    return SimpleNamespace(key_expr=key, kind=kind)


class Session:
    """A session in which there are tokens, and caches that answer."""

    def __init__(self, *tokens: Any, answers: tuple[Any, ...] = ()) -> None:
        self.tokens, self.answers = tokens, answers
        self.asked: list[str] = []
        self.undeclared = 0

    def liveliness(self) -> Any:
        return self

    def declare_subscriber(self, expression: str, heard: Callable[[Any], None], *, history: bool) -> Any:
        assert history
        for token in self.tokens:
            heard(token)
        return SimpleNamespace(undeclare=self.undeclare)

    def undeclare(self) -> None:
        self.undeclared += 1

    def get(self, selector: str, **options: Any) -> list[Any]:
        self.asked.append(selector)
        return [SimpleNamespace(ok=each) for each in self.answers]


@pytest.fixture(autouse=True)
def without_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(libraries._by_type, Session, LIBRARY)


def recorded(session: Session, *, wanted: Callable[[str], bool] = lambda key: True) -> list[tuple[str, list[Any]]]:
    rows: list[tuple[str, list[Any]]] = []
    caches = LatchedCaches(session, wanted=wanted, record=lambda key, samples: rows.append((key, samples)))  # type: ignore[arg-type]
    caches._worker.close()  # runs what is to be done
    caches.close()
    caches.close()
    assert session.undeclared == 1
    return rows


def test_each_announced_cache_is_asked_once_for_its_own_key() -> None:
    first, second = sample("map"), sample("map")
    session = Session(sample("map/@adv/pub/abc/7/_"), answers=(first, None, sample("other"), second))
    assert recorded(session) == [("map", [first, second])]
    assert session.asked == ["map/@adv/pub/abc/7/**"]


def test_what_is_not_wanted_or_is_gone_or_not_of_one_key_is_not_asked_for() -> None:
    tokens = (
        sample("no/@adv/pub/a/1/_"),
        sample("map/@adv/pub/a/1/_", kind=1),
        sample("a/*/@adv/pub/a/1/_"),
        sample("x"),
    )
    session = Session(*tokens, answers=(sample("map"),))
    assert recorded(session, wanted=lambda key: key != "no") == []
    assert session.asked == []


def test_an_empty_cache_records_nothing() -> None:
    assert recorded(Session(sample("map/@adv/pub/abc/7/_"))) == []
