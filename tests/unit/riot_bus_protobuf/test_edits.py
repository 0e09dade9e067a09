from __future__ import annotations

from itertools import permutations

import pytest

from riot_bus.types import model
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_protobuf.edits import Edit, apply
from riot_bus_protobuf.walk import LengthPrefix
from riot_bus_protobuf.wire import varint

CORE = b"abcdef"
OUTER = LengthPrefix(1, 2, 12, 0, None)
INNER = LengthPrefix(4, 5, 11, 1, OUTER)
DATA = b"<\x0a[(\x06" + CORE + b"]>"
"""A message in a message: the core from 5 to 11, the outer one from 2 to 12."""


def built(core: bytes) -> bytes:
    inside = b"[(" + varint(len(core)) + core + b"]"
    return b"<" + varint(len(inside)) + inside + b">"


def test_the_sample_is_such_a_message() -> None:
    outer = b"[(\x06" + CORE + b"]"
    assert (OUTER.end - OUTER.body, INNER.end - INNER.body) == (len(outer), len(CORE))
    assert built(CORE) == DATA


@pytest.mark.parametrize("size", [0, 1, 6, 117, 124, 125, 127, 128, 20_000])
def test_all_lengths_around_a_change_are_right_even_if_they_get_longer(size: int) -> None:
    assert apply(DATA, [Edit(5, 11, b"x" * size, INNER)]) == built(b"x" * size)


def test_edits_come_in_any_order() -> None:
    edits = [Edit(5, 6, b"", INNER), Edit(7, 8, b"long" * 50, INNER), Edit(11, 11, b"end", INNER)]
    expected = built(b"b" + b"long" * 50 + b"defend")
    assert {apply(DATA, each) for each in permutations(edits)} == {expected}


def test_a_change_of_the_same_size_changes_nothing_else() -> None:
    assert apply(DATA, [Edit(5, 11, b"fedcba", INNER)]) == DATA.replace(CORE, b"fedcba")
    assert apply(DATA, []) == DATA


def test_at_the_same_place_what_is_inside_comes_first() -> None:
    grown = apply(DATA, [Edit(11, 11, b"outer", OUTER), Edit(11, 11, b"inner", INNER)])
    assert grown == b"<\x14[(\x0b" + CORE + b"inner" + b"outer" + b"]>"


def test_a_payload_cannot_grow_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model, "MOST_BYTES", 20)
    with pytest.raises(PayloadError, match="over the limit of 20"):
        apply(DATA, [Edit(11, 11, b"x" * 100, INNER)])
    assert len(apply(DATA, [Edit(5, 11, b"x" * 13, INNER)])) == 20
