from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.advanced import answers as module
from riot_bus.router.advanced.answers import Answers
from riot_bus.router.advanced.source import AdvancedSource
from riot_bus.zenoh import libraries

ASKED = "chatter/@adv/pub/abc/**"


class Callback:
    def __init__(self, call: Any, drop: Any = None, *, indirect: bool) -> None:
        self.call, self.drop = call, drop


class Session:
    """A segment's session, whose caches have one sample each, and which takes one query."""

    def __init__(self) -> None:
        self.queryables: dict[str, Callback] = {}
        self.gets: list[str] = []

    def declare_queryable(self, text: str, take: Callback, **options: Any) -> Any:
        self.queryables[text] = take
        return SimpleNamespace(undeclare=lambda: self.queryables.pop(text))

    def get(self, selector: str, handler: Callback, **options: Any) -> None:
        self.gets.append(selector)
        sample = SimpleNamespace(key_expr="chatter", payload=selector, encoding="", attachment=None, timestamp=None)
        handler.call(SimpleNamespace(ok=sample))
        handler.call(SimpleNamespace(ok=None))
        handler.drop()


class Query:
    def __init__(self, key: str = ASKED) -> None:
        self.key_expr, self.parameters = key, "_max=3"
        self.replies: list[Any] = []
        self.dropped = 0

    def reply(self, key: str, payload: Any, **more: Any) -> None:
        assert not self.dropped
        self.replies.append(payload)

    def drop(self) -> None:
        self.dropped += 1


class Worker:
    """A worker whose delayed jobs wait until somebody calls them."""

    def __init__(self) -> None:
        self.jobs: list[Any] = []

    def do(self, job: Any) -> None:
        job()

    def later(self, seconds: float, job: Any, *, background: bool) -> None:
        self.jobs.append(job)


def state(segment: str, *caches: str, opened: bool = True) -> Any:
    outlets = {name: SimpleNamespace(cache=f"{cache}/@cache") for name, cache in zip(("unit",), caches, strict=False)}
    return SimpleNamespace(source=AdvancedSource(segment, "chatter", "abc", "1"), opened=opened, outlets=outlets)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that asks in the segment `unit`, given the states that are known."""
    library = SimpleNamespace(
        ZError=LookupError,
        handlers=SimpleNamespace(Callback=Callback),
        Locality=SimpleNamespace(REMOTE="remote", SESSION_LOCAL="here"),
        QueryTarget=SimpleNamespace(ALL="all"),
        ConsolidationMode=SimpleNamespace(NONE="none"),
        ReplyKeyExpr=SimpleNamespace(ANY="any"),
    )
    for kind in (Session, Query):
        monkeypatch.setitem(libraries._by_type, kind, library)
    session, worker = Session(), Worker()

    def ask(*states: Any, key: str = ASKED) -> tuple[Query, Session, Worker]:
        sessions: Any = {"unit": session}
        answers = Answers(sessions, worker, lambda key, zid: [*states] if (key, zid) == ("chatter", "abc") else [])  # type: ignore[arg-type]
        answers.begin("chatter")
        answers.begin("chatter")
        query = Query(key)
        session.queryables["chatter/@adv/pub/**"].call(query)
        answers.end("chatter")
        assert not session.queryables
        return query, session, worker

    return ask


def test_the_caches_of_the_other_segments_answer_one_after_the_other(asked: Any) -> None:
    query, session, _ = asked(state("system", "first"), state("unit", "own"), state("system", "second"))
    assert session.gets == ["first/@cache?_max=3", "second/@cache?_max=3"]
    assert query.replies == session.gets
    assert query.dropped == 1


@pytest.mark.parametrize("key", ["chatter/@adv/pub/other/**", "chatter/@adv/pub/abc/1/**", "chatter/@adv/pub/**", "x"])
def test_other_queries_end_at_once(asked: Any, key: str) -> None:
    query, session, _ = asked(state("system", "first"), key=key)
    assert (query.replies, query.dropped, session.gets) == ([], 1, [])


def test_a_history_that_is_under_way_is_waited_for(asked: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    late = state("system", "first", opened=False)
    query, session, worker = asked(late)
    assert (query.dropped, session.gets) == (0, [])
    late.opened = True
    worker.jobs.pop()()
    assert (query.dropped, len(query.replies), worker.jobs) == (1, 1, [])


def test_it_is_not_waited_for_long(asked: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    query, _, worker = asked(state("system", "first", opened=False))
    now = time.monotonic()
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now + 2.0))
    worker.jobs.pop()()
    assert (query.dropped, len(query.replies)) == (1, 1)
