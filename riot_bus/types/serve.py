"""Requests to services and their replies as messages: their keys say what they are, so that selectors can choose them.

A request for `KEY` is a message on `KEY/@request`, a reply one on `KEY/@reply`, and a reply that tells of an error one
on `KEY/@error`. The last chunk is one that no wildcard of Zenoh matches, so `**` means none of them. Nobody publishes
on such keys: they are names for the pipeline, for counts and for logs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["ERROR", "PARTS", "REPLY", "REQUEST", "Request", "Serving", "part_of"]

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


@runtime_checkable
class Serving(Protocol):
    """What an adapter can do besides `Adapter`, if its middleware has services.

    Attributes:
        services: Key expressions of services whose callers only ask those who call themselves complete
            (Zenoh's target `ALL_COMPLETE`), as all their servers do.
    """

    services: Sequence[str]

    def action_parts(self, name: str) -> str | None:
        """Return what topics and services are called of which an action of this name consists; None if it has none.

        Args:
            name: As people write it; it may have wildcards.
        """
        ...

    def call_type(self, type_name: str, part: str) -> str | None:
        """Return the type of a part of a call, None if it has none.

        Args:
            type_name: Of the service.
            part: One of `PARTS`.
        """
        ...
