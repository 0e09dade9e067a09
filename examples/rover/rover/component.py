"""What all components have in common: topics in, topics out, and no idea of the network."""

from __future__ import annotations

import sys
from time import monotonic

from rover.cdr import DecodeError
from rover.topics import TOPICS

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

    from rover.messages import Message

    Publish = Callable[[str, Message], object]


class Component:
    """Takes messages by topic and hands out messages by topic.

    Attributes:
        NAME: Name of the component, as it signs its warnings.
        INPUTS: Topics it takes. The method for `/a/b` is `on_a_b`.
        OUTPUTS: Topics it hands out.
    """

    NAME = ""
    INPUTS: tuple[str, ...] = ()
    OUTPUTS: tuple[str, ...] = ()
    QUIET = 1.0

    def __init__(self, publish: Publish) -> None:
        self.publish = publish
        self._handlers = {
            topic: (TOPICS[topic].decode, getattr(self, "on" + topic.replace("/", "_"))) for topic in self.INPUTS
        }
        self._warned: dict[str, list[float]] = {}

    def receive(self, topic: str, payload: bytes) -> None:
        """Take one message as it came; refuse it with a warning if it cannot be read."""
        decode, handle = self._handlers[topic]
        try:
            message = decode(payload)
        except DecodeError as problem:
            self.warn(f"{topic} refused", str(problem))
        else:
            handle(message)

    def warn(self, what: str, detail: str) -> None:
        """Write a warning, but at most one per second about the same thing."""
        now = monotonic()
        record = self._warned.setdefault(what, [-self.QUIET, 0])
        if now - record[0] < self.QUIET:
            record[1] += 1
            return
        more = f" ({record[1]:.0f} more since)" if record[1] else ""
        print(f"[{self.NAME}] {what}: {detail}{more}", file=sys.stderr)
        record[:] = now, 0
