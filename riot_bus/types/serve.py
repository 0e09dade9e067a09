"""Requests to services and their replies as messages: their keys say what they are, so that selectors can choose them.

A request for `KEY` is a message on `KEY/@request`, a reply one on `KEY/@reply`, and a reply that tells of an error one
on `KEY/@error`. The last chunk is one that no wildcard of Zenoh matches, so `**` means none of them. Nobody publishes
on such keys: they are names for the pipeline, for counts and for logs.
"""

from __future__ import annotations

from dataclasses import dataclass

from riot_bus.vocabulary.message import Message

__all__ = ["ERROR", "PARTS", "REPLY", "REQUEST", "Request", "part_of"]

REQUEST, REPLY, ERROR = PARTS = ("@request", "@reply", "@error")


@dataclass(frozen=True, slots=True)
class Request(Message):
    """A request.

    Attributes:
        parameters: What stands behind the question mark of its selector.
    """

    parameters: str = ""

    def with_payload(self, payload: bytes) -> Message:
        """Return a copy with another payload and the same parameters."""
        return self.with_(payload=payload)


def part_of(key: str) -> tuple[str, str] | None:
    """Return the service's key or name, and which part of a call a key or name means; None if it is a topic's.

    Example:
        >>> part_of("/add_two_ints/@request")
        ('/add_two_ints', '@request')
    """
    base, slash, part = key.rpartition("/")
    return (base, part) if slash and part in PARTS else None
