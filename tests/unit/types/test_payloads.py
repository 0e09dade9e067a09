from __future__ import annotations

import numpy as np
import pytest

from riot_bus.types.payloads import Payloads

PARTS = [b"one", b"", b"three", b"t"]


@pytest.fixture
def payloads() -> Payloads:
    """Payloads that overlap and are not in the order of the buffer."""
    buffer = b"..three..one"
    return Payloads(buffer, np.array([buffer.index(part) for part in PARTS]), np.array([*map(len, PARTS)]))


def test_each_payload_is_its_part_of_the_buffer(payloads: Payloads) -> None:
    assert (list(payloads), len(payloads)) == (PARTS, 4)


def test_some_are_taken_by_number_in_that_order_or_by_mask(payloads: Payloads) -> None:
    assert list(payloads.take(np.array([3, 0, 0]))) == [b"t", b"one", b"one"]
    some = payloads.take(np.array([True, False, True, False]))
    assert list(some) == [b"one", b"three"]
    assert some.buffer is payloads.buffer
    assert list(some.take(np.zeros(0, np.int64))) == []
