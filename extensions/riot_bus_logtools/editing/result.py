"""The result of an edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(slots=True)
class EditCounts:
    """The messages of one topic: `read == kept + dropped`, and the output holds `kept + added`.

    Attributes:
        topic: Name in the input; for topics that an interceptor has made, in the output.
        written_as: Name in the output, empty if nothing of the topic is kept.
        changed: Kept messages of which more was changed than their topic, or their time by `--shift`.
        added: Messages that are only in the output: copies, and those that interceptors have added.
        originals: Kept originals, which are not counted otherwise.
    """

    topic: str
    written_as: str = ""
    read: int = 0
    kept: int = 0
    changed: int = 0
    dropped: int = 0
    added: int = 0
    originals: int = 0


@dataclass(frozen=True, slots=True)
class WrittenFile:
    """A file of the output."""

    path: str
    size: int
    messages: int


@dataclass(frozen=True, slots=True)
class EditResult:
    """The result of an edit.

    Attributes:
        losses: Descriptions of what could not be read, such as "the file was not closed", by path of the input; only of
            inputs with losses.
        unwritable: Number of messages whose time would not fit into a log, by topic.
    """

    topics: Sequence[EditCounts]
    files: Sequence[WrittenFile] = ()
    losses: Mapping[str, str] = field(default_factory=dict)
    unwritable: Mapping[str, int] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    hint: str | None = None

    def total(self) -> EditCounts:
        """Return the sums over all topics."""
        names = ("read", "kept", "changed", "dropped", "added", "originals")
        return EditCounts("", **{name: sum(getattr(each, name) for each in self.topics) for name in names})

    def document(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        total = asdict(self.total())
        del total["topic"], total["written_as"]
        return {**asdict(self), "total": total}
