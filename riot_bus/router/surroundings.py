"""What the parts of a bus share: access to its segments, and what its users may change while messages pass."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.router.byte_gate import ByteBudget
from riot_bus.zenoh.convert import Converter, Outlets

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from riot_bus.interceptors.recorder import Recorder
    from riot_bus.router.advanced.publisher_state import PublisherState
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.convert import Claims


class BusAccess:
    """Ways in and out of the segments of a bus.

    Attributes:
        sessions: The segments' own sessions, once `open` was called.
        outlets: Publishers by segment, once `open` was called.
        targets: Target segments of messages, by source segment.
        budget: Bytes of large messages that may wait in front of forwarders.
    """

    def __init__(self, segments: Collection[str]) -> None:
        self.sessions: dict[str, zenoh.Session] = {}
        self.outlets: dict[str, Outlets] = {}
        self.sequence = itertools.count(1)
        self.converters = {name: Converter(name, self.sequence) for name in segments}
        self.targets = {name: tuple(other for other in segments if other != name) for name in segments}
        self.budget = ByteBudget()

    def open(self, sessions: Mapping[str, zenoh.Session]) -> None:
        """Publish through these sessions."""
        self.sessions.update(sessions)
        self.outlets.update({name: Outlets(session) for name, session in sessions.items()})


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What messages meet on their way; immutable, since it is replaced while messages pass.

    Attributes:
        claims: Intercepted expressions and the keys that belong to each.
        stream_of: Function of the message that came in, if any, and one that interceptors have let through, that
            returns the advanced publisher to whose stream this one belongs; None if there are no such publishers.
        observed: Segments to which a subscriber in this process listens.
    """

    claims: Claims
    recorder: Recorder | None = None
    stream_of: Callable[[Message | None, Message], PublisherState | None] | None = None
    observed: frozenset[str] = frozenset()
