"""Message definitions as stored in logs: a dialect with one message and the enums that it refers to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.definitions import EnumTable, MessageTable
from riot_bus_mavlink.xml_files import DialectFile, parse_dialect

ENCODING = "mavlink"
"""The encoding of payloads (one frame each) and of schemas in MCAP."""


def schema_of(name: str, message: MessageTable, enums: Mapping[str, EnumTable]) -> Schema:
    """Return the definition of a message for a log."""
    return Schema(name, ENCODING, "\n".join(_lines(message, enums)).encode())


def parse_schema(schema: Schema) -> DialectFile | None:
    """Return the definition of a message from a log's schema, None if it is not such a definition."""
    if schema.encoding != ENCODING or not schema.data:
        return None
    try:
        found = parse_dialect(schema.data, where=schema.name)
    except ConfigError:
        return None
    return found if len(found.messages) == 1 and not found.includes else None


def _lines(message: MessageTable, enums: Mapping[str, EnumTable]) -> Iterator[str]:
    from xml.sax.saxutils import quoteattr  # imported late: it imports HTTP and TLS

    fields = [place.field for place in message.places.values()]
    named = sorted({field.enum for field in fields} & enums.keys())
    yield "<mavlink>"
    yield " <enums>"
    for name in named:
        table = enums[name]
        bitmask = ' bitmask="true"' if table.bitmask else ""
        yield f"  <enum name={quoteattr(name)}{bitmask}>"
        for entry in table.entries.values():
            yield f'   <entry value="{entry.value}" name={quoteattr(entry.name)}/>'
        yield "  </enum>"
    yield " </enums>"
    yield " <messages>"
    yield f'  <message id="{message.id}" name={quoteattr(message.name)}>'
    extended = False
    for field in fields:
        if field.extension and not extended:
            yield "   <extensions/>"
            extended = True
        array = f"[{field.array}]" if field.array else ""
        told = {"units": field.unit, "enum": field.enum, "invalid": field.invalid}
        limits = {"minValue": field.low, "maxValue": field.high}
        more = "".join(f" {key}={quoteattr(text)}" for key, text in told.items() if text)
        more += "".join(f' {key}="{value!r}"' for key, value in limits.items() if value is not None)
        more += ' display="bitmask"' if field.bitmask else ""
        yield f"   <field type={quoteattr(field.type + array)} name={quoteattr(field.name)}{more}/>"
    yield "  </message>"
    yield " </messages>"
    yield "</mavlink>"
