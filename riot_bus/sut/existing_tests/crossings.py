"""Whether intercepted messages had a subscriber in another segment: within one segment they bypass riot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from riot_bus.router.receivers import Receivers
from riot_bus.zenoh.session import includes

if TYPE_CHECKING:
    from collections.abc import Collection

    from riot_bus.router.bus import Bus

__all__ = ["Crossings"]


class Crossings:
    """Notes in which segments intercepted keys ever had a subscriber, even briefly; a context manager.

    Args:
        bus: Bus that is open.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._receivers = Receivers(bus)

    def __enter__(self) -> Self:
        for expression in self._bus.intercepted:
            self._receivers.watch(expression)
        return self

    def __exit__(self, *error: object) -> None:
        self._receivers.__exit__(*error)

    def count(self, inhabited: Collection[str]) -> int:
        """Return how many messages came from one segment and had a subscriber in another one.

        Args:
            inhabited: Segments that have components: a recorder of everything looks like a subscriber in each.
        """
        heard = {text: self._receivers.heard(text) & set(inhabited) for text in self._bus.intercepted}
        return sum(
            number
            for (key, segment), number in self._bus.flows().items()
            if any(where - {segment} and includes(text, key) for text, where in heard.items())
        )
