"""What is known about one log: in the store that holds it, and in the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

NamedBy = Literal["log", "option", "folder"]
"""Where the name of a log's robot comes from."""

LATEST = (1 << 63) - 1
"""Latest time and largest number that a catalogue holds; larger ones are stored as this one."""


ENDING = ".mcap"
"""Suffix of the names of logs."""


@dataclass(frozen=True, slots=True)
class StoredLog:
    """A log in a store.

    Attributes:
        folder: Name of the folder directly below the root that holds it; of the root itself if it is not in any.
    """

    place: str
    size: int
    stamp: str
    folder: str


@dataclass(frozen=True, slots=True)
class TopicEntry:
    """One topic of a log: `count` messages, and the originals of `originals` messages that interceptors touched."""

    topic: str
    key: str
    type: str
    encoding: str
    count: int
    originals: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry:
    """One log.

    Attributes:
        stamp: Value that changes when the file does: time of its last change, or the object's etag.
        readable: Whether it is a log at all; if not, `problem` says why and nothing else is known.
        start: Time of the first message, nanoseconds since the Unix epoch; None if there is none.
        gone: Whether it was missing when its folder was last looked at.
        scanned: Whether all of it was read, not only its summary.
    """

    place: str
    size: int
    stamp: str
    robot: str
    named_by: NamedBy = "folder"
    readable: bool = True
    problem: str = ""
    profile: str = ""
    start: int | None = None
    end: int | None = None
    messages: int = 0
    lost: int = 0
    topics: tuple[TopicEntry, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)
    number: int = 0
    gone: bool = False
    scanned: bool = False

    @property
    def seconds(self) -> float:
        """Time from the first to the last message."""
        return (self.end - self.start) / 1e9 if self.start is not None and self.end is not None else 0.0
