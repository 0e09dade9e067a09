"""Segments with subscribers of a key: a message without subscriber in another segment was not tested."""

from __future__ import annotations

import functools
from collections import defaultdict
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from riot_bus.router.bus import Bus


class Receivers:
    """Notes in which segments a key expression ever had a subscriber, even briefly; a context manager.

    Exact for what is intercepted, if no component outside a segment subscribes to more than is cut.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._heard: defaultdict[str, set[str]] = defaultdict(set)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def watch(self, expression: str) -> None:
        """Start to watch the subscribers of a key expression."""
        if expression in self._heard:
            return
        heard = self._heard[expression]
        for segment, session in self._bus.sessions.items():
            zenoh = library_of(session)
            pin(session, expression)
            publisher = session.declare_publisher(expression, allowed_destination=zenoh.Locality.REMOTE)
            note = functools.partial(_note, heard, segment)
            handler: Any = zenoh.handlers.Callback(note, indirect=False)
            listener = publisher.declare_matching_listener(handler)
            self._stack.callback(release, listener, publisher)
            note(publisher.matching_status)

    def heard(self, expression: str) -> set[str]:
        """Return the segments in which a component has subscribed since `watch`."""
        return set(self._heard.get(expression, ()))


def _note(heard: set[str], segment: str, status: Any) -> None:
    if status.matching:
        heard.add(segment)
