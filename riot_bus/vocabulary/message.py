"""A message on the bus: one put or delete on a key, with everything that must survive re-publication."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any, Literal

CACHED_KEYS = 1 << 14
"""Most keys that are remembered: anybody may invent keys, and to empty a full cache costs only time."""

Scalar = bool | int | float | str | bytes
"""Value of one scalar field."""


@dataclass(frozen=True, slots=True)
class Qos:
    """Delivery settings of one message, by Zenoh's names (priority 1 = real time ... 7 = background)."""

    priority: int = 5
    congestion: Literal["drop", "block", "block_first"] = "drop"
    express: bool = False


@dataclass(frozen=True, slots=True)
class Message:
    """One put or delete.

    Attributes:
        time: Time of reception, in nanoseconds since the Unix epoch.
        key: Zenoh key without wildcards.
        payload: Bytes exactly as on the wire.
        kind: `put` or `delete`.
        encoding: Zenoh's encoding string, empty for the default.
        attachment: Bytes that travel with the payload, or None.
        segment: Segment of the bus on which it was published; empty if unknown.
        sequence: Number given by the source if it has one, else by the recorder or router.
        publish_time: Time at the source in nanoseconds, None if unknown.
    """

    time: int
    key: str
    payload: bytes
    kind: Literal["put", "delete"] = "put"
    encoding: str = ""
    attachment: bytes | None = None
    qos: Qos = Qos()
    segment: str = ""
    sequence: int = 0
    publish_time: int | None = None

    def with_(self, **changes: Any) -> Message:
        """Return a copy with some attributes replaced."""
        return replace(self, **changes)

    def sent(self, time: int, qos: Qos) -> Message:
        """Return a copy with another time and other delivery settings; much faster than `with_`."""
        return Message(
            time,
            self.key,
            self.payload,
            self.kind,
            self.encoding,
            self.attachment,
            qos,
            self.segment,
            self.sequence,
            self.publish_time,
        )

    def with_payload(self, payload: bytes) -> Message:
        """Return a copy with another payload."""
        return Message(
            self.time,
            self.key,
            payload,
            self.kind,
            self.encoding,
            self.attachment,
            self.qos,
            self.segment,
            self.sequence,
            self.publish_time,
        )

    def digest(self) -> bytes:
        """Return a hash of what a receiver can see (without times and sequence numbers)."""
        digest = hashlib.sha256(self.key.encode())
        for part in (self.kind.encode(), self.encoding.encode(), self.attachment or b"", self.payload):
            digest.update(len(part).to_bytes(8, "little"))
            digest.update(part)
        return digest.digest()
