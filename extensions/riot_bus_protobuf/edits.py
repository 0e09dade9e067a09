"""Edits of a message's bytes: enclosing length prefixes are updated, all other bytes stay the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from riot_bus.types.model import check_size
from riot_bus_protobuf.wire import varint

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus_protobuf.walk import LengthPrefix


class Edit(NamedTuple):
    """Replacement of the bytes from `start` to `end`; length prefixes are updated from `box` outwards."""

    start: int
    end: int
    data: bytes
    box: LengthPrefix | None

    @property
    def growth(self) -> int:
        """Number of bytes by which the payload grows."""
        return len(self.data) - (self.end - self.start)


def apply(data: bytes, edits: Sequence[Edit]) -> bytes:
    """Return the payload with all edits made; raise PayloadError if it gets too large."""
    more = sum(edit.growth for edit in edits)
    if more > 0:
        check_size(len(data) + more)
    done = [*edits, *_counts(edits)]
    # at the same place, edits of an inner message come before those of the message around it
    done.sort(key=lambda edit: (edit.start, -edit.box.depth if edit.box else 1))
    parts = []
    at = 0
    for edit in done:
        parts += [data[at : edit.start], edit.data]
        at = edit.end
    return b"".join([*parts, data[at:]])


def _counts(edits: Sequence[Edit]) -> list[Edit]:
    """Return the edits of length prefixes that change, from the inside outwards."""
    boxes: dict[int, LengthPrefix] = {}
    grown: dict[int, int] = {}
    for edit in edits:
        _grow(edit.box, edit.growth, boxes, grown)
    found = []
    for place in sorted(boxes, key=lambda place: -boxes[place].depth):
        box = boxes[place]
        if grown[place]:
            written = Edit(box.prefix, box.body, varint(box.end - box.body + grown[place]), box.outer)
            _grow(box.outer, written.growth, boxes, grown)
            found.append(written)
    return found


def _grow(box: LengthPrefix | None, by: int, boxes: dict[int, LengthPrefix], grown: dict[int, int]) -> None:
    while box is not None:
        boxes[box.prefix] = box
        grown[box.prefix] = grown.get(box.prefix, 0) + by
        box = box.outer
