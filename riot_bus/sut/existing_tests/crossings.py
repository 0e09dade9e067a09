"""Whether intercepted messages had somewhere to go: who is alone in a segment gets everything directly, past riot."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Self

from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import includes, release

if TYPE_CHECKING:
    from collections.abc import Collection

    from riot_bus.router.bus import Bus

__all__ = ["Crossings"]


class Crossings:
    """Notes in which segments somebody has subscribed to what is intercepted, if only for a moment; a context manager.

    Args:
        bus: The bus, open.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._heard: set[tuple[str, str]] = set()
        self._open: list[Any] = []

    def __enter__(self) -> Self:
        for segment, session in self._bus.sessions.items():
            zenoh = library_of(session)
            for expression in self._bus.intercepted:
                pin(session, expression)
                publisher = session.declare_publisher(expression, allowed_destination=zenoh.Locality.REMOTE)
                note = functools.partial(self._note, segment, expression)
                handler: Any = zenoh.handlers.Callback(note, indirect=False)
                self._open += [publisher.declare_matching_listener(handler), publisher]
                note(publisher.matching_status)
        return self

    def __exit__(self, *_: object) -> None:
        release(*self._open)

    def _note(self, segment: str, expression: str, status: Any) -> None:
        if status.matching:
            self._heard.add((segment, expression))

    def count(self, inhabited: Collection[str]) -> int:
        """Return how many messages came from one segment and have had a subscriber in another one.

        Args:
            inhabited: Segments that have components: a recorder of everything looks like a subscriber in each.
        """
        heard = [(segment, expression) for segment, expression in self._heard.copy() if segment in inhabited]
        return sum(
            number
            for (key, segment), number in self._bus.flows().items()
            if any(where != segment and includes(expression, key) for where, expression in heard)
        )
