"""A Zenoh sample on its way through the pipeline, converted only on demand."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

__all__ = ["SampleArrival"]


class SampleArrival:
    """A sample that was received.

    Args:
        sample: The sample as received.
        key: Key of the sample.
        time: Time of reception, in nanoseconds since the Unix epoch.
        segment: Segment that it came from.
        convert: Function that makes a message of sample and time.
    """

    __slots__ = ("_convert", "_message", "_payload", "_sample", "key", "segment", "time")

    def __init__(
        self,
        sample: zenoh.Sample,
        key: str,
        time: int,
        segment: str,
        convert: Callable[[zenoh.Sample, int], Message],
    ) -> None:
        self._sample = sample
        self._convert = convert
        self._message: Message | None = None
        self._payload: bytes | None = None
        self.key = key
        self.time = time
        self.segment = segment

    def payload(self) -> bytes:
        """Return the payload."""
        if self._payload is None:
            self._payload = self._sample.payload.to_bytes()
        return self._payload

    def message(self) -> Message:
        """Return the message; the same object each time."""
        if self._message is None:
            self._message = self._convert(self._sample, self.time)
        return self._message
