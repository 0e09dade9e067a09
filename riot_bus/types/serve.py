"""Requests to services and their replies as messages, with keys by which selectors can choose them.

A request for `KEY` is a message on `KEY/@request`, a reply a message on `KEY/@reply`, and an error reply a message on
`KEY/@error`. Zenoh's wildcards do not match the last chunk, so `**` includes none of them. Such keys are never
published: they are names for the pipeline, for counts and for logs.
"""

from __future__ import annotations

from dataclasses import dataclass

from riot_bus.vocabulary.message import Message

REQUEST, REPLY, ERROR = PARTS = ("@request", "@reply", "@error")


@dataclass(frozen=True, slots=True)
class Request(Message):
    """A request."""

    parameters: str = ""

    def with_payload(self, payload: bytes) -> Message:
        """Return a copy with another payload and the same parameters."""
        return self.with_(payload=payload)


def part_of(key: str) -> tuple[str, str] | None:
    """Return the service's key or name, and the part of a call; None if the key or name is that of a topic.

    Example:
        >>> part_of("/add_two_ints/@request")
        ('/add_two_ints', '@request')
    """
    base, slash, part = key.rpartition("/")
    return (base, part) if slash and part in PARTS else None
