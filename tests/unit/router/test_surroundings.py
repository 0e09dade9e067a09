from __future__ import annotations

from dataclasses import FrozenInstanceError

import pytest

from riot_bus.router.surroundings import BusAccess, Surroundings
from tests.unit.router.fake_bus import Claims


def test_each_segment_sends_to_all_others_and_numbers_are_shared() -> None:
    access = BusAccess(("a", "b", "c"))
    assert access.targets == {"a": ("b", "c"), "b": ("a", "c"), "c": ("a", "b")}
    assert [next(access.sequence), next(access.converters["a"]._sequence)] == [1, 2]


def test_surroundings_are_replaced_not_changed() -> None:
    present = Surroundings(Claims())  # type: ignore[arg-type]
    with pytest.raises(FrozenInstanceError):
        present.recorder = None  # type: ignore[misc]
