from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router import observers as module
from riot_bus.router.observers import Observers, wait_subscribed
from riot_bus.vocabulary.message import Message
from tests.unit.router.fake_bus import LIBRARY, WAIT_S, eventually, message


class Publisher:
    """Has subscribers once the test says so."""

    def __init__(self, session: Session, key: str) -> None:
        self._session, self._key = session, key

    @property
    def matching_status(self) -> Any:
        return SimpleNamespace(matching=self._key in self._session.subscribed)

    def declare_matching_listener(self, handler: Any) -> Publisher:
        self._session.listeners.append(handler)
        return self

    def undeclare(self) -> None:
        self._session.released.append(self._key)


class Session:
    def __init__(self) -> None:
        self.subscribed: set[str] = set()
        self.listeners: list[Any] = []
        self.released: list[str] = []
        self.callbacks: list[Any] = []

    def declare_publisher(self, key: str, **options: Any) -> Publisher:
        return Publisher(self, key)

    def declare_subscriber(self, key: str, callback: Any, *, allowed_origin: str) -> Publisher:
        self.callbacks.append((callback, allowed_origin))
        return Publisher(self, f"subscriber of {key}")


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.setattr(module, "library_of", lambda thing: LIBRARY)
    monkeypatch.setattr(module, "StoreFilter", lambda zid: lambda sample: sample == b"stored")
    return Session()


def convert(sample: bytes) -> Message:
    return message(sample)


def test_observers_are_called_on_one_thread_and_end_with_the_bus(session: Session) -> None:
    observers = Observers(lambda key: f"/{key}")
    threads: set[str] = set()
    seen: list[bytes] = []

    def see(each: Message) -> None:
        threads.add(threading.current_thread().name)
        seen.append(each.payload)

    segment: Any = SimpleNamespace(session=session, zid="1", name="unit")
    for own in (True, False):
        observers.subscribe(segment, "a", see, own=own, convert=convert)  # type: ignore[arg-type]
    assert [origin for _, origin in session.callbacks] == ["any", "remote"]
    for payload in (b"0", b"stored", b"1"):
        session.callbacks[0][0](payload)
    assert eventually(lambda: len(seen) == 2 and observers.idle())
    observers.close()
    observers.close()
    assert seen == [b"0", b"1"]
    assert threads == {"riot-observe"}
    assert session.released == ["subscriber of a"] * 2


def test_a_key_is_heard_once_a_component_has_subscribed(session: Session) -> None:
    observers = Observers(str)
    segment: Any = SimpleNamespace(session=session, zid="1", name="unit")
    assert not observers.hears(segment, "a")
    session.subscribed.add("a")
    assert observers.hears(segment, "a")
    observers.close()
    assert session.released == ["a"]


def test_waiting_ends_with_the_last_subscription(session: Session) -> None:
    session.subscribed.add("a")

    def subscribe() -> None:
        eventually(lambda: len(session.listeners) == 2)
        session.subscribed.add("b")
        session.listeners[-1](None)

    thread = threading.Thread(target=subscribe)
    thread.start()
    assert wait_subscribed(session, ["a", "b"], timeout=WAIT_S, alive=lambda: True) == []  # type: ignore[arg-type]
    thread.join(WAIT_S)


def test_waiting_ends_when_it_is_pointless_and_says_what_is_missing(session: Session) -> None:
    session.subscribed.add("a")
    found = wait_subscribed(session, ["a", "b"], timeout=WAIT_S, alive=lambda: False)  # type: ignore[arg-type]
    assert found == ["b"]
    assert sorted(session.released) == ["a", "a", "b", "b"]
