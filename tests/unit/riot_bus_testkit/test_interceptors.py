"""The conformance class of interceptors holds for the shipped ones, and finds what is wrong with others."""

from __future__ import annotations

import random

import pytest

from riot_bus.interceptors.copies import Duplicate
from riot_bus.interceptors.losses import Bandwidth, Drop, Throttle
from riot_bus.interceptors.payloads import ClockOffset, Corrupt, Freeze, Truncate
from riot_bus.interceptors.timing import Delay, Jitter, Reorder
from riot_bus_testkit.interceptors import InterceptorBench, InterceptorConformance

SHIPPED = {
    "bandwidth": lambda: Bandwidth(bytes_per_second=100.0),
    "clock_offset": lambda: ClockOffset(seconds=1.0, field="x"),
    "corrupt": lambda: Corrupt(),
    "delay": lambda: Delay(0.5),
    "drop": lambda: Drop(every=3),
    "duplicate": lambda: Duplicate(),
    "freeze": lambda: Freeze(),
    "jitter": lambda: Jitter(seconds=0.5, spread=0.2),
    "reorder": lambda: Reorder(window=0.1),
    "throttle": lambda: Throttle(rate=10.0),
    "truncate": lambda: Truncate(length=3),
}


@pytest.mark.parametrize("made", SHIPPED.values(), ids=list(SHIPPED))
class TestShipped(InterceptorConformance):
    @pytest.fixture(autouse=True)
    def _chosen(self, made) -> None:
        self.made = made

    def make(self) -> object:
        return self.made()


class Raises:
    def message(self, event) -> None:
        raise RuntimeError(event.payload)


class Rolls:
    def message(self, event) -> None:
        if random.random() < 0.5:
            event.drop()


def run(made: type, test: str) -> None:
    case = type("Case", (InterceptorConformance,), {"make": lambda self: made()})()
    getattr(case, test)()


def test_one_that_raises_is_found() -> None:
    with pytest.raises(AssertionError):
        run(Raises, "test_strange_inputs_are_survived")


def test_one_that_rolls_dice_of_its_own_is_found() -> None:
    with pytest.raises(AssertionError):
        run(Rolls, "test_it_repeats_itself")


def test_the_bench_says_what_was_delivered_and_when() -> None:
    with InterceptorBench(Delay(0.5)) as bench:
        bench.feed(1.0, {"x": 2})
        assert bench.times() == [1.5]
        assert bench.payloads() == [b'{"x": 2}']
        assert bench.errors == []
