from __future__ import annotations

import pytest

from riot_bus.types.model import Schema
from riot_bus_mavlink.definitions import EnumEntry, EnumTable, FieldText, make_message
from riot_bus_mavlink.schema_text import ENCODING, parse_schema, schema_of

MESSAGE = make_message(
    16_777_215,
    "SAMPLE",
    [
        FieldText("lat", "int32_t", unit="degE7", invalid='INT32_MAX "&<', low=-9e8, high=9e8),
        FieldText("flags", "uint8_t", enum="FLAGS", bitmask=True),
        FieldText("text", "char", 50),
        FieldText("late", "double", 2, extension=True, low=0.1 + 0.2),
    ],
)
ENUMS = {
    "FLAGS": EnumTable("FLAGS", True, {value: EnumEntry(f"F{value}", value) for value in (1, 128)}),
    "OTHER": EnumTable("OTHER"),
}


def test_the_definition_in_a_log_is_the_whole_message_with_the_enums_that_it_names() -> None:
    schema = schema_of("mavlink/SAMPLE", MESSAGE, ENUMS)
    assert (schema.name, schema.encoding) == ("mavlink/SAMPLE", ENCODING)
    found = parse_schema(schema)
    assert found is not None
    assert found.messages == [MESSAGE]
    assert found.enums == [ENUMS["FLAGS"]]


@pytest.mark.parametrize(
    ("encoding", "data"),
    [
        ("ros2msg", schema_of("x", MESSAGE, ENUMS).data),
        (ENCODING, b""),
        (ENCODING, b"<mavlink/>"),
        (ENCODING, b"not XML"),
        (ENCODING, schema_of("x", MESSAGE, ENUMS).data.replace(b" <enums>", b"<include>/etc/passwd</include><enums>")),
        (ENCODING, schema_of("x", MESSAGE, ENUMS).data.replace(b"</message>", b"</message><message id='2' name='B'/>")),
    ],
    ids=["other encoding", "empty", "no message", "no XML", "include", "two messages"],
)
def test_what_is_no_definition_of_one_message(encoding: str, data: bytes) -> None:
    assert parse_schema(Schema("x", encoding, data)) is None
