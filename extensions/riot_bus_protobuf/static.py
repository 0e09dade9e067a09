"""The fields of a message type, known without a payload."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.types.fields import MOST_FIELDS, FieldType
from riot_bus.types.model import MAX_DEPTH, member_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus_protobuf.layout import Definitions, Layout, ProtobufField

_MOST_MESSAGES = 100_000  # messages without scalars may nest exponentially, and never reach `MOST_FIELDS`


def static_fields(definitions: Definitions, layout: Layout) -> Sequence[FieldType]:
    """List the fields of a message in the order of the definition, `MOST_FIELDS` at most.

    The values of a map are written `counts["*"]`; the contents of a recursive message are listed only once.
    """
    listing = _Listing(definitions)
    listing.add(layout, "", ())
    return listing.found[:MOST_FIELDS]


class _Listing:
    def __init__(self, definitions: Definitions) -> None:
        self.found: list[FieldType] = []
        self._definitions = definitions
        self._messages = 0

    def add(self, layout: Layout, path: str, outer: tuple[str, ...]) -> None:
        self._messages += 1
        enough = self._messages > _MOST_MESSAGES or len(self.found) >= MOST_FIELDS
        if enough or layout.name in outer or len(outer) > MAX_DEPTH:
            return
        for field in layout.fields.values():
            here = member_path(path, field.name)
            entry = self._definitions.entry(field)
            if entry is not None:
                self._add_one(entry.numbers[2], f'{here}["*"]', (*outer, layout.name))
            elif field.repeated:
                self.found.append(FieldType(f"len({here})", "uint32"))
                self._add_one(field, f"{here}[*]", (*outer, layout.name))
            else:
                self._add_one(field, here, (*outer, layout.name))

    def _add_one(self, field: ProtobufField, path: str, outer: tuple[str, ...]) -> None:
        if field.kind is None:
            self.add(self._definitions.inside(field), path, outer)
        else:
            self.found.append(FieldType(path, field.kind.leaf, 0, field.low, field.high, field.unit, field.names))
