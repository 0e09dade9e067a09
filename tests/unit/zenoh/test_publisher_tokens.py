from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.zenoh import libraries
from riot_bus.zenoh import publisher_tokens as module
from riot_bus.zenoh.publisher_tokens import Announcements

ROLES = {"pub": "publishes", "sub": "subscribes"}


class Learner:
    """Notes for which keys it is to look; is idle at the second look."""

    def __init__(self, registry: Any, *, tokens: Any, wanted: Any, learnt: Any) -> None:
        self.sessions: list[Any] = []
        self.looks: list[str] = []
        self.answers = iter([False, True])
        self.closed = 0

    def look(self, key: str) -> None:
        self.looks.append(key)

    def idle(self) -> bool:
        return next(self.answers)

    def close(self) -> None:
        self.closed += 1


class Session:
    """A session with a token of a publisher that the query does not answer with."""

    def __init__(self) -> None:
        self.queries: list[str] = []
        self.undeclared = 0

    def liveliness(self) -> Session:
        return self

    def declare_subscriber(self, expression: str, heard: Any, *, history: bool) -> Any:
        assert history
        self.say = heard
        heard(token("pub chatter"))
        return SimpleNamespace(undeclare=self.undeclare)

    def get(self, expression: str, *, timeout: float) -> list[Any]:
        self.queries.append(expression)
        return [token("pub outdated")]

    def undeclare(self) -> None:
        self.undeclared += 1


class Adapter:
    tokens = "@tokens/**"

    def details(self, key: str, tokens: list[str]) -> dict[str, str]:
        return {"tokens": " ".join(sorted(each for each in tokens if each.endswith(key)))}


def token(text: str, *, gone: bool = False) -> Any:
    return SimpleNamespace(key_expr=text, kind=int(gone))


def announcement(text: str) -> Any:
    role, _, key = text.partition(" ")
    return SimpleNamespace(role=ROLES[role], key=key) if role in ROLES else None


@pytest.fixture
def announcements(monkeypatch: pytest.MonkeyPatch) -> Announcements:
    monkeypatch.setattr(module, "Learner", Learner)
    library = SimpleNamespace(handlers=SimpleNamespace(Callback=lambda call, indirect: call))
    monkeypatch.setitem(libraries._by_type, Session, library)
    adapter = Adapter()
    registry: Any = SimpleNamespace(
        metadata_adapters=lambda: [adapter],
        metadata_adapter=lambda key: adapter if key != "plain" else None,
        announcement=announcement,
    )
    return Announcements(registry, wanted=lambda key: True, learnt=lambda key: None)


def test_present_tokens_are_those_of_the_subscription_and_not_of_the_query(announcements: Announcements) -> None:
    assert not announcements
    session: Any = Session()
    announcements.watch(session)
    assert announcements
    assert session.queries == ["@tokens/**"]
    assert announcements.details("chatter") == {"tokens": "pub chatter"}
    assert announcements.details("outdated") == {"tokens": ""}
    assert announcements.details("plain") == {}


def test_types_are_sought_of_what_is_published(announcements: Announcements) -> None:
    session: Any = Session()
    announcements.watch(session, wait=False)
    for each in (token("sub other"), token("odd"), token("pub map"), token("pub map", gone=True)):
        session.say(each)
    learner: Any = announcements._learner
    assert (session.queries, learner.looks, learner.sessions) == ([], ["chatter", "map"], [session])
    assert announcements.details("map") == {"tokens": ""}
    assert announcements.details("other") == {"tokens": "sub other"}


def test_tokens_without_end_take_no_memory_without_end(
    announcements: Announcements, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MOST_TOKENS", 2)
    session: Any = Session()
    announcements.watch(session, wait=False)
    for text in ("pub a", "pub b"):
        session.say(token(text))
    assert [announcements.details(key)["tokens"] for key in ("a", "b")] == ["pub a", ""]
    session.say(token("pub a", gone=True))
    session.say(token("pub b"))
    assert announcements.details("b")["tokens"] == "pub b"


def test_nothing_is_left_after_the_end(announcements: Announcements) -> None:
    session: Any = Session()
    announcements.watch(session, wait=False)
    announcements.close()
    announcements.close()
    learner: Any = announcements._learner
    assert (session.undeclared, learner.closed) == (1, 2)
