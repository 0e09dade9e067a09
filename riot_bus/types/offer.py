"""How a recorded topic is published again, so that its subscribers take it for the original: what adapters say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from riot_bus.types.model import Schema

__all__ = ["Identity", "Offer", "Offering", "RecordedTopic", "SimClock"]


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """What a log says of a topic.

    Attributes:
        name: What people call it, such as `/odom`.
        key: Its Zenoh key; the name where the log knows no keys.
        keyed: Whether the log knows keys: riot_bus has recorded it.
        schema: The type's definition, empty if there is none.
        encoding: MCAP's message encoding, such as `cdr`.
        details: All that the log's channel says, such as `offered_qos_profiles`.
    """

    name: str
    key: str
    keyed: bool
    schema: Schema
    encoding: str
    details: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Identity:
    """A publisher as its subscribers know it.

    Attributes:
        tokens: Keys of the liveliness tokens that announce it.
        attachment: Returns the attachment of a message, from the recorded one (or None), the message's number at this
            publisher (1, 2, ...) and the present time in nanoseconds.
    """

    tokens: Sequence[str] = ()
    attachment: Callable[[bytes | None, int, int], bytes | None] | None = None


@dataclass(frozen=True, slots=True)
class Offer:
    """How to publish a topic.

    Attributes:
        key: Zenoh key.
        depth: Late joiners get so many of the last messages; None if they get none.
        reliable: Whether what was lost is sent again to those who ask.
        block: Whether a slow subscriber holds up the publisher, whatever was recorded.
        identify: Returns who publishes, from the session's id and the publisher's number in it.
    """

    key: str
    depth: int | None = None
    reliable: bool = True
    block: bool = False
    identify: Callable[[str, int], Identity] | None = None


@dataclass(frozen=True, slots=True)
class SimClock:
    """How time is told to those who follow a simulated clock.

    Attributes:
        name: What people call the topic; a recorded one of this name is not played beside it.
        offer: How to publish it.
        payload: Returns the payload for a time in nanoseconds.
    """

    name: str
    offer: Offer
    payload: Callable[[int], bytes]


@runtime_checkable
class Offering(Protocol):
    """What an adapter can do besides `Adapter`, if its middleware wants more than key and payload."""

    def offer(self, topic: RecordedTopic, *, name: str | None, domain: int | None) -> Offer | None:
        """Return how to publish a topic, None if it is not of this adapter's kind.

        Args:
            topic: What was recorded.
            name: Another name for it.
            domain: Another domain for it, in middleware that has such.
        """
        ...

    def clock(self, topics: Sequence[RecordedTopic], *, domain: int | None) -> SimClock | None:
        """Return how to tell the time, None if this middleware has no simulated time.

        Args:
            topics: What is played.
            domain: Another domain than theirs.
        """
        ...
