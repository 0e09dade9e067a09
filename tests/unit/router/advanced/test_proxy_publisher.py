from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from riot_bus.router.advanced.proxy_publisher import ProxyPublisher, StoreFilter


def sample(number: int | None, *, zid: str = "ours", entity: int = 1) -> Any:
    if number is None:
        return SimpleNamespace(source_info=None)
    return SimpleNamespace(
        source_info=SimpleNamespace(source_id=SimpleNamespace(zid=zid, eid=entity), source_sn=number)
    )


def test_observers_hear_a_stored_sample_when_it_is_sent_and_only_then() -> None:
    only_stored = StoreFilter("ours")
    # stored and sent; two that are stored alone; one of them is sent later, out of order
    assert [only_stored(sample(number)) for number in (0, 0, 1, 2, 3, 3, 2)] == [
        True,
        False,
        True,
        True,
        True,
        False,
        False,
    ]


def test_caches_are_told_apart_and_others_samples_pass() -> None:
    only_stored = StoreFilter("ours")
    assert only_stored(sample(0, entity=1))
    assert only_stored(sample(0, entity=2))
    assert not only_stored(sample(0, entity=1))
    assert not only_stored(sample(5, zid="theirs"))
    assert not only_stored(sample(None))


def test_a_heartbeat_that_claims_everything_costs_few_puts() -> None:
    puts: list[bytes] = []
    proxy = ProxyPublisher.__new__(ProxyPublisher)
    proxy._cache, proxy._next = SimpleNamespace(put=puts.append), 5
    proxy.skip(3)
    assert (len(puts), proxy._next) == (3, 8)
    proxy.skip((1 << 32) - 1)
    assert len(puts) == 3 + 256
    assert proxy._next == 8 + 256
