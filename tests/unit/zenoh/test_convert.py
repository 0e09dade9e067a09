from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh import convert as module
from riot_bus.zenoh import libraries
from riot_bus.zenoh.convert import Claims, Converter, Outlets, SampleArrival, is_delete, is_droppable
from tests.unit.router.fake_bus import sample

NAMES = ("REAL_TIME", "INTERACTIVE_HIGH", "INTERACTIVE_LOW", "DATA_HIGH", "DATA", "DATA_LOW", "BACKGROUND")
CONGESTION = ("DROP", "BLOCK", "BLOCK_FIRST")


class ClosedError(Exception):
    pass


class Session:
    """A session that notes what is published, and how: by itself, or by a publisher."""

    def __init__(self) -> None:
        self.said: list[Any] = []
        self.declared: list[Any] = []

    def put(self, key: str, payload: Any, *, encoding: Any, attachment: Any, **qos: Any) -> None:
        self.said.append(("session", key, payload, encoding, attachment, qos))

    def delete(self, key: str, *, attachment: Any, **qos: Any) -> None:
        self.said.append(("session", key, "delete", attachment, qos))

    def declare_publisher(self, key: str, *, encoding: Any, **qos: Any) -> Any:
        self.declared.append((key, qos))
        return SimpleNamespace(
            put=lambda payload, encoding, attachment: self.said.append(("publisher", key, payload, encoding)),
            delete=lambda attachment: self.said.append(("publisher", key, "delete")),
        )


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Any:
    library = SimpleNamespace(
        ZError=ClosedError,
        Encoding=lambda text: f"<{text}>",
        Priority=SimpleNamespace(**{name: number for number, name in enumerate(NAMES, 1)}),
        CongestionControl=SimpleNamespace(**{name: number for number, name in enumerate(CONGESTION)}),
    )
    monkeypatch.setitem(libraries._by_type, Session, library)
    return Session()


@pytest.mark.parametrize("priority", range(1, 8))
@pytest.mark.parametrize("congestion", [0, 1, 2])
def test_delivery_settings_survive_conversion(session: Any, priority: int, congestion: int) -> None:
    received = sample(priority=priority, congestion=congestion, express=True)
    qos = Converter("unit", itertools.count()).qos(received)
    outlets = Outlets(session)
    outlets.publisher("a", qos)
    assert session.declared == [("a", {"priority": priority, "congestion_control": congestion, "express": True})]
    assert is_droppable(received) is (qos.congestion == "drop")


def test_a_message_has_all_of_a_sample_and_the_next_number() -> None:
    convert = Converter("unit", itertools.count(5))
    received = sample(b"x", "cut/a", encoding="text/plain", attachment=b"more", congestion=0)
    expected = Message(7, "cut/a", b"x", "put", "text/plain", b"more", Qos(5, "drop"), "unit", 5)
    assert convert.at(received, 7) == expected
    gone = convert.at(sample(b"", encoding="zenoh/bytes", kind=1), 8)
    assert (gone.kind, gone.encoding, gone.attachment, gone.sequence) == ("delete", "", None, 6)
    assert is_delete(sample(kind=1))
    assert not is_delete(sample())


def test_an_arrival_is_converted_once_if_at_all() -> None:
    numbers = itertools.count()
    arrival = SampleArrival(sample(b"x"), "cut/a", 7, Converter("unit", numbers))
    assert (arrival.payload(), next(numbers)) == (b"x", 0)
    assert arrival.message() is arrival.message()
    assert (arrival.message().time, arrival.message().sequence, next(numbers)) == (7, 1, 2)


def test_only_recurring_keys_get_a_publisher(session: Any) -> None:
    outlets = Outlets(session)
    for payload in (b"0", b"1", b"2", b"3"):
        outlets.publish(Message(0, "a", payload))
    outlets.publish(Message(0, "b", b"4", encoding="text/plain", attachment=b"+"))
    outlets.publish(Message(0, "b", b"", "delete"))
    assert [row[:3] for row in session.said] == [
        ("session", "a", b"0"),
        ("session", "a", b"1"),
        ("publisher", "a", b"2"),
        ("publisher", "a", b"3"),
        ("session", "b", b"4"),
        ("session", "b", "delete"),
    ]
    assert session.said[4][3:5] == ("<text/plain>", b"+")
    assert [key for key, _ in session.declared] == ["a"]


def test_keys_without_end_take_no_memory_without_end(session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CACHED_PUBLISHERS", 3)
    outlets = Outlets(session)
    for number in range(20):
        outlets.publisher(str(number), Qos())
        outlets.publish(Message(0, f"rare/{number}", b"", encoding=f"e{number}"))
    kept = (outlets._publishers, outlets._encodings, outlets._times)
    assert all(len(each) <= 4 for each in kept)
    assert len(session.declared) == 20


def test_the_longest_publication_is_known(session: Any) -> None:
    outlets = Outlets(session)
    for seconds in (0.2, 0.5, 0.1):
        outlets.took(seconds)
    assert outlets.longest_s == 0.5


def test_shared_memory_is_used_if_there_is_any(session: Any) -> None:
    def refuse(size: int) -> None:
        raise ClosedError

    provider = SimpleNamespace(alloc=lambda size, policy: bytearray(size))
    library = libraries.library_of(session)
    library.shm = SimpleNamespace(ShmProvider=SimpleNamespace(default_backend=refuse), GarbageCollect=object)
    assert Outlets(session).shared(b"abc") == b"abc"
    library.shm.ShmProvider.default_backend = lambda size: provider
    assert (Outlets(session).shared(b""), Outlets(session).shared(b"abc")) == (b"", bytearray(b"abc"))


def test_the_first_expression_that_matches_owns_a_key() -> None:
    claims = Claims(["a/b", "a/**", "c"])
    assert [claims.owner(key) for key in ("a/b", "a/x", "c", "d", "a/b")] == ["a/b", "a/**", "c", None, "a/b"]


def test_owners_may_be_others_and_claims_within_others() -> None:
    outer = Claims(["a/**"])
    claims = Claims(["*/x", "b/y"], owners=["a/**", "b/**"], within=outer)
    assert [claims.owner(key) for key in ("a/x", "a/y", "b/x", "b/y")] == ["a/**", None, None, None]
    assert Claims(["*/x"], owners=["b/**"]).owner("a/x") is None
