"""Samples and replies as JSON: everything that a receiver can see, except what differs from run to run."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from typing import Any

END = b"riot-end"
"""Payload of a message after which nothing more is expected."""

_SHORT = 40  # the scenarios' counters and words are shorter; of longer payloads, a hash is compared


def _bytes(data: bytes) -> str:
    if len(data) > _SHORT:
        return f"{len(data)} bytes, sha256 {hashlib.sha256(data).hexdigest()[:16]}"
    try:
        return data.decode()
    except UnicodeDecodeError:
        return "0x" + data.hex()


def show(sample: Any) -> dict[str, Any]:
    """Return the visible parts of a sample; of timestamp and source, only whether they are present."""
    return {
        "key": str(sample.key_expr),
        "payload": _bytes(sample.payload.to_bytes()),
        "kind": "delete" if int(sample.kind) else "put",
        "encoding": str(sample.encoding),
        "attachment": None if sample.attachment is None else _bytes(sample.attachment.to_bytes()),
        "priority": int(sample.priority),
        "congestion": int(sample.congestion_control),
        "express": sample.express,
        "timestamp": sample.timestamp is not None,
        "source": sample.source_info is not None,
    }


def show_replies(replies: Any) -> list[dict[str, Any]]:
    """Return all replies to a query, in an order that does not depend on who was faster."""
    shown = []
    for reply in replies:
        if reply.ok is not None:
            shown.append(show(reply.ok))
        else:
            shown.append({"error": _bytes(reply.err.payload.to_bytes()), "encoding": str(reply.err.encoding)})
    return sorted(shown, key=str)


def keys_of(samples: Sequence[Any]) -> list[list[str]]:
    """Return the key and the text of each sample."""
    return [[str(sample.key_expr), sample.payload.to_string()] for sample in samples]


def sequence(samples: Sequence[Any]) -> list[dict[str, Any]]:
    """Return the visible parts of an advanced publisher's samples, with sequence numbers relative to the first."""
    numbers = [sample.source_info.source_sn if sample.source_info else None for sample in samples]
    first = next((number for number in numbers if number is not None), 0)
    relative = [None if number is None else number - first for number in numbers]
    return [{**show(sample), "number": number} for sample, number in zip(samples, relative, strict=True)]


class CallCollector:
    """Collects whatever a handler is called with."""

    def __init__(self) -> None:
        self._items: list[Any] = []
        self._changed = threading.Condition()

    def __call__(self, item: Any) -> None:
        """Add an item."""
        with self._changed:
            self._items.append(item)
            self._changed.notify_all()

    def wait(self, enough: Callable[[list[Any]], bool] = bool, timeout: float = 10.0) -> list[Any]:
        """Return the items once there are enough, or those that came in time: too few are an observation too."""
        with self._changed:
            self._changed.wait_for(lambda: enough(self._items), timeout)
            return list(self._items)


class Inbox(CallCollector):
    """Collects samples."""

    def __init__(self) -> None:
        super().__init__()
        self.handle: Any = None
        self._ends = 0

    def __call__(self, sample: Any) -> None:
        """Add a sample."""
        with self._changed:
            self._ends += sample.payload.to_bytes() == END
            super().__call__(sample)

    def received(self, count: int, timeout: float = 10.0) -> list[Any]:
        """Return the samples as soon as there are `count` or the time is up."""
        return self.wait(lambda samples: len(samples) >= count, timeout)

    def take(self, count: int, timeout: float = 10.0) -> list[dict[str, Any]]:
        """Return the visible parts of the samples, as soon as there are `count` or the time is up."""
        return [show(sample) for sample in self.received(count, timeout)]

    def until_end(self, ends: int = 1, timeout: float = 10.0) -> list[Any]:
        """Return the samples before the closing ones."""
        samples = self.wait(lambda _: self._ends >= ends, timeout)
        return [sample for sample in samples if sample.payload.to_bytes() != END]

    def shown(self, ends: int = 1, timeout: float = 10.0) -> list[dict[str, Any]]:
        """Return the visible parts of the samples before the closing ones."""
        return [show(sample) for sample in self.until_end(ends, timeout)]
