"""Counts what a reader could not read of a log."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from riot_bus.log.engine.blocks import Span
from riot_bus.log.engine.limits import BeyondLimitError
from riot_bus.log.limits import refusal

if TYPE_CHECKING:
    from riot_bus.log.engine.blocks import Block
    from riot_bus.log.engine.scan import Scan

_TEXTS = {
    "bytes": "bytes that are not a whole record",
    "chunks": "damaged chunks",
    "salvaged": "messages of them salvaged, unverified",
    "salvageable": "messages of them could be salvaged",
    "messages": "messages of unknown channels",
    "details": "damaged attachments, notes or definitions",
    "conflicts": "channels defined in different ways",
    "unsorted": "messages out of order",
    "beyond": "chunks beyond the limits",
}


@dataclass(frozen=True, slots=True)
class Loss:
    """What a reader could not read; false when nothing is missing.

    Attributes:
        unfinished: The file was never closed: what its writer had not yet written is lost.
        bytes: Bytes that are not a whole record: at the end, or after a damaged length.
        chunks: Damaged chunks that were left out, and those that the summary counts but that are missing.
        messages: Messages that were left out because their channel is unknown or their time is impossible.
        details: Damaged extras, provenance or definitions: messages lack attachments, notes or their type, but not
            their payload.
        conflicts: Channels that are defined in different ways; all their messages are taken for the first one's.
        unsorted: Messages that come later than their time: chunks state wrong times, or sorting the chunks that
            overlap would take too much memory.
        salvaged: Messages of damaged chunks that were taken because an index confirms them; their payloads may still
            be damaged.
        salvageable: Messages of damaged chunks that could be salvaged in this way, if they were counted.
        beyond: Chunks that were left out because of a limit.
        limit: The first limit that was exceeded, by what, and how to lift it; empty if none was.
    """

    unfinished: bool = False
    bytes: int = 0
    chunks: int = 0
    messages: int = 0
    details: int = 0
    conflicts: int = 0
    unsorted: int = 0
    salvaged: int = 0
    salvageable: int = 0
    beyond: int = 0
    limit: str = ""

    def __bool__(self) -> bool:
        return self != Loss()

    @property
    def hint(self) -> str | None:
        """What to do about damaged chunks; None if there is nothing to be done, or it was done."""
        if self.salvaged or not (self.salvageable or self.chunks):
            return None
        return "riot edit, play and export take what an index confirms of damaged chunks with --salvage"

    def __str__(self) -> str:
        parts = ["the file was not closed"] if self.unfinished else []
        parts += [f"{number} {text}" for name, text in _TEXTS.items() if (number := getattr(self, name))]
        reason = f" ({self.limit})" if self.limit else ""
        return ", ".join(parts) + reason or "nothing lost"


@dataclass(slots=True)
class LossNotes:
    """What a reader has found missing so far, by block number, so that nothing is counted twice.

    Attributes:
        damaged: Blocks that cannot be read.
        salvaged: Messages that were read all the same, by damaged block.
        unknown: Messages with an unknown channel or an impossible time, by block.
        unsorted: Messages that come after messages with later times, by block.
    """

    damaged: set[int] = field(default_factory=set)
    salvaged: dict[int, int] = field(default_factory=dict)
    unknown: dict[int, int] = field(default_factory=dict)
    unsorted: dict[int, int] = field(default_factory=dict)
    _beyond: set[int] = field(default_factory=set)
    _details: set[int] = field(default_factory=set)
    _refused: BeyondLimitError | None = None

    def note_damage(self, block: Block, problem: ValueError) -> None:
        """Note that a block cannot be read, or must not be."""
        (self._beyond if self._is_limit(problem) else self.damaged).add(block.number)

    def note_detail(self, place: Block | Span, problem: Exception | None = None) -> None:
        """Note that data about a block's messages, or a record other than messages, cannot be read."""
        self._is_limit(problem)
        self._details.add(-place.offset if isinstance(place, Span) else place.number)  # no number of a block

    def total(self, scan: Scan) -> Loss:
        """Return all that is missing of a file."""
        refused = scan.refused or self._refused
        missing = max(scan.missing_chunks, scan.dropped)
        skipped = missing if scan.stopped else scan.dropped
        return Loss(
            unfinished=not scan.finished,
            bytes=scan.unread,
            chunks=len(self.damaged) + missing - skipped,
            messages=sum(self.unknown.values()),
            details=len(self._details) + len(scan.damaged),
            conflicts=len(scan.conflicts),
            unsorted=sum(self.unsorted.values()),
            salvaged=sum(self.salvaged.values()),
            beyond=len(self._beyond) + skipped,
            limit="" if refused is None else refusal(refused),
        )

    def _is_limit(self, error: Exception | None) -> bool:
        """Return whether an error is due to a limit, and remember the first one."""
        if not isinstance(error, BeyondLimitError):
            return False
        self._refused = self._refused or error
        return True
