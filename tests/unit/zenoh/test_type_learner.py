from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.zenoh import libraries
from riot_bus.zenoh import type_learner as module
from riot_bus.zenoh.type_learner import Learner
from tests.unit.router.fake_bus import Bytes

WAIT_S = 20.0


class ClosedError(Exception):
    pass


class Probe:
    """A subscription that hears a message at once."""

    attachments = (b"heard",)

    def __init__(self, key: str, sessions: Any, heard: Callable[[], None]) -> None:
        heard()

    def close(self) -> None:
        pass


class Session:
    """A session in which somebody answers in this way."""

    def __init__(self, *answers: bytes | None, closed: bool = False) -> None:
        self.answers, self.closed = answers, closed
        self.asked: list[Any] = []

    def get(self, key: str, **options: Any) -> Iterator[Any]:
        if self.closed:
            raise ClosedError
        self.asked.append((key, options["payload"], options["attachment"]))
        return (SimpleNamespace(ok=each and SimpleNamespace(payload=Bytes(each))) for each in self.answers)


class Registry:
    """Types that are missing until somebody tells them."""

    def __init__(self) -> None:
        self.answers: list[list[bytes]] = []
        self.fault: Exception | None = None
        self.heard: list[Any] = []

    def missing(self, key: str) -> bool:
        if self.fault is not None and key == "faulty":
            raise self.fault
        return key != "known"

    def learn(self, key: str, tokens: Any, heard: Any, ask: Any) -> bool:
        self.heard.append((key, list(tokens), list(heard)))
        self.answers.append(list(ask(f"{key}/type", b"what", b"who")))
        return any(self.answers[-1])

    def topic(self, key: str) -> str:
        return f"/{key}"


class Learning:
    """A learner of what is wanted, which tells what it has learnt."""

    def __init__(self, *sessions: Session) -> None:
        self.registry, self.wanted, self.learnt = Registry(), {"a", "b", "faulty", "known"}, list[str]()
        self.changed = threading.Event()
        self.learner = Learner(
            self.registry,  # type: ignore[arg-type]
            tokens=lambda: ["token"],
            wanted=lambda key: key in self.wanted,
            learnt=self._take,
        )
        self.learner.sessions += sessions  # type: ignore[arg-type]

    def _take(self, key: str) -> None:
        self.learnt.append(key)
        self.changed.set()

    def learn(self, *keys: str) -> list[str]:
        for key in keys:
            self.learner.look(key)
        assert self.changed.wait(WAIT_S)
        self.learner.close()
        return self.learnt


@pytest.fixture(autouse=True)
def without_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    library = SimpleNamespace(
        ZError=ClosedError,
        CancellationToken=lambda: SimpleNamespace(cancel=lambda: None),
        ConsolidationMode=SimpleNamespace(NONE="none"),
        Locality=SimpleNamespace(REMOTE="remote"),
    )
    monkeypatch.setitem(libraries._by_type, Session, library)
    monkeypatch.setattr(module, "AttachmentProbe", Probe)
    monkeypatch.setattr(module, "_FIRST_S", 0.0)


def test_those_who_use_a_key_are_asked_for_its_type() -> None:
    session = Session(b"float64 x")
    learning = Learning(session)
    assert learning.learn("a") == ["a"]
    assert session.asked == [("a/type", b"what", b"who")]
    assert learning.registry.heard == [("a", ["token"], [b"heard"])]
    assert learning.learner.idle()
    learning.learner.look("b")  # it is closed
    assert learning.learnt == ["a"]


def test_sessions_are_asked_until_one_has_an_answer_of_a_usable_size() -> None:
    sessions = Session(closed=True), Session(None, b"x" * (1 << 21)), Session(b"one", b"two"), Session(b"other")
    learning = Learning(*sessions)
    learning.learn("a")
    assert learning.registry.answers == [[b"one", b"two"]]
    assert [len(each.asked) for each in sessions] == [0, 1, 1, 0]


def test_many_answers_are_not_read_for_ever() -> None:
    learning = Learning(Session(*[b"x"] * 1000))
    learning.learn("a")
    assert len(learning.registry.answers[0]) < 10


def test_what_is_known_or_unwanted_is_not_asked_for() -> None:
    session = Session(b"float64 x")
    learning = Learning(session)
    learning.learn("known", "unwanted", "a")
    assert [key for key, *_ in session.asked] == ["a/type"]
    assert learning.learner.idle()


def test_a_faulty_adapter_is_not_asked_again_and_others_go_on(caplog: pytest.LogCaptureFixture) -> None:
    learning = Learning(Session(b"float64 x"))
    learning.registry.fault = ZeroDivisionError()
    assert learning.learn("faulty", "a") == ["a"]
    assert "the type of faulty cannot be learnt" in caplog.text


def test_who_never_answers_is_left_alone_until_somebody_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_AGAIN_S", (0.0, 0.0))
    session = Session(None)
    learning = Learning(session)
    monkeypatch.setattr(Probe, "close", lambda probe: learning.changed.set())
    assert learning.learn("a") == []
    assert len(session.asked) == 3


def test_questions_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_QUESTIONS", 2)
    sessions = [Session(None), Session(None), Session(b"late")]
    learning = Learning(*sessions)
    monkeypatch.setattr(Probe, "close", lambda probe: learning.changed.set())
    monkeypatch.setattr(module, "_AGAIN_S", ())
    assert learning.learn("a") == []
    assert [len(each.asked) for each in sessions] == [1, 1, 0]
