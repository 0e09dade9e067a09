"""Simulated time: ticks at a fixed rate, each due at a wall time that does not drift."""

from __future__ import annotations

from time import monotonic

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

    from rover.bus import Bus
    from rover.component import Component
    from rover.messages import Stamp
    from rover.options import Options

NANOSECONDS = 1_000_000_000


def stamp_of(tick: int, rate: int) -> Stamp:
    """Give the time of a tick as a ROS stamp."""
    return divmod(tick * NANOSECONDS // rate, NANOSECONDS)


def ticks(bus: Bus, component: Component, rate: int, options: Options) -> Iterator[int]:
    """Count ticks as they fall due, and let the component receive in between.

    A tick that is late follows at once, so that the number of messages does not depend on the machine.
    """
    start = monotonic()
    tick = 0
    while not options.duration or tick < options.duration * rate:
        bus.spin(component, until=start + tick / (rate * options.speed))
        yield tick
        tick += 1
