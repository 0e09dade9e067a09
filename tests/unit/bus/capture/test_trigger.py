from __future__ import annotations

from riot_bus.bus.capture.trigger import Trigger
from riot_bus.types.registry import TypeRegistry


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
