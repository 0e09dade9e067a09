from __future__ import annotations

import pytest

from riot_bus.monitors.arrivals import Rate, Reached, Sometimes
from riot_bus.monitors.invariants import Finite, Range
from riot_bus.record.trigger import Trigger
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError


def test_it_fires_when_a_condition_begins_to_hold() -> None:
    trigger = Trigger(["a/* where v > 10"], registry=TypeRegistry())
    look, other = trigger.for_key("a/x"), trigger.for_key("b")
    assert other is None
    assert look is not None
    fired = []
    for value in (1, 11, 12, 3, 13):
        look(b'{"v": %d}' % value, "a/x")
        fired.append(trigger.take(0.0))
    assert fired == [None, "a/* where v > 10", None, None, "a/* where v > 10"]


def test_what_cannot_be_read_does_not_fire() -> None:
    trigger = Trigger(["a where v > 10"], registry=TypeRegistry())
    look = trigger.for_key("a")
    assert look is not None
    for payload in (b"", b"\xff", b'{"w": 1}', b'{"v": "text"}', b"{"):
        look(payload, "a")
    assert trigger.take(0.0) is None


def test_it_waits_for_what_follows() -> None:
    trigger = Trigger(["a where v > 10"], registry=TypeRegistry())
    look = trigger.for_key("a")
    assert look is not None
    look(b'{"v": 11}', "a")
    assert trigger.take(3600.0) is None
    assert trigger.take(0.0) is not None


class Clock:
    def __init__(self) -> None:
        self.now = 0

    def __call__(self) -> int:
        return self.now


def test_a_value_that_violates_a_monitor_fires_once() -> None:
    monitors = [Range("a:v", max=10.0), Finite("a:v")]
    trigger = Trigger([], registry=TypeRegistry(), monitors=monitors, clock=Clock())
    assert trigger.for_key("b") is None
    look = trigger.for_key("a")
    assert look is not None
    fired = []
    for value in (1, 11, 12, 3, "NaN", 13):
        look(f'{{"v": {value}}}'.encode(), "a")
        fired.append(trigger.take(0.0))
    said = "a:v = 11.0 is outside [-inf, 10]", "a:v = nan is outside [-inf, 10]"
    assert fired == [None, said[0], None, None, said[1], None]
    for payload in (b"", b"\xff", b'{"w": 1}', b"{"):
        look(payload, "a")
    assert trigger.take(0.0) is None


def test_silence_violates_a_rate() -> None:
    clock = Clock()
    trigger = Trigger([], registry=TypeRegistry(), monitors=[Rate("a", gap=1.0)], clock=clock)
    look = trigger.for_key("a")
    assert look is not None
    fired = []
    for tenths in (5, 9, 15, 20, 30, 31, 35, 50):
        clock.now = tenths * 10**8
        if tenths in (9, 31, 35):
            look(b"1", "a")
        fired.append(trigger.take(0.0))
    first, second = (f"no a for {seconds} s (allowed: 1 s)" for seconds in ("1.100", "1.500"))
    assert fired == [None, None, None, first, None, None, None, second]


@pytest.mark.parametrize("kind", [Sometimes, Reached])
def test_a_monitor_of_whole_trials_is_refused(kind: type[Sometimes | Reached]) -> None:
    with pytest.raises(ConfigError, match=f"{kind.__name__} judges whole trials"):
        Trigger([], registry=TypeRegistry(), monitors=[kind("a where v > 1")])
