from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.zenoh import libraries
from riot_bus.zenoh.batches import Batches
from tests.unit.router.fake_bus import LIBRARY, Channel, Session, sample


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setitem(libraries._by_type, Session, LIBRARY)
    return Session()


def fill(session: Any, samples: Iterable[Any]) -> None:
    for each in samples:
        session.channel.queue.put(each)


def test_a_batch_is_all_that_waits_in_order(session: Any) -> None:
    batches = Batches(session, "cut/**")
    fill(session, [sample(text) for text in (b"0", b"1", b"2")])
    assert [bytes(each.payload) for each in batches.receive()] == [b"0", b"1", b"2"]
    fill(session, [sample(b"3")])
    assert [bytes(each.payload) for each in batches.receive()] == [b"3"]


def test_a_batch_is_bounded_by_number_and_by_the_size_of_the_payloads_before(session: Any) -> None:
    large = SimpleNamespace(payload=range(1 << 22), key_expr="cut/a")
    batches = Batches(session, "cut/**")
    fill(session, [sample()] * 1000)
    first = len(batches.receive())
    assert 256 <= first <= 600
    assert len(batches.receive()) == 1000 - first
    fill(session, [large] * 10)
    assert len(batches.receive()) == 10
    fill(session, [large] * 10)
    assert len(batches.receive()) == 4  # 16 MiB
    fill(session, [sample()])
    assert [len(batches.receive()) for _ in range(2)] == [4, 3]


def test_what_was_received_before_the_end_comes_out_first(session: Any) -> None:
    batches = Batches(session, "cut/**")
    fill(session, [sample(b"0")])
    batches.close()
    batches.close()
    assert len(batches.receive()) == 1
    assert batches.receive() == batches.receive() == []


def test_closing_is_done_once(session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[object] = []
    monkeypatch.setattr(Channel, "undeclare", lambda channel: closed.append(channel))
    batches = Batches(session, "cut/**")
    batches.close()
    batches.close()
    assert closed == [session.channel]
