"""Every message of every dialect: encode, decode, and patch each field, byte for byte as pymavlink does."""

import math
import random

import pytest

from riot_bus_mavlink.definitions import MessageTable
from riot_bus_mavlink.dialect import dialect_names, load_dialect
from riot_bus_mavlink.frame import pack_frame
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.signing import Signer
from riot_bus_mavlink.slots import slots_of
from tests.unit.riot_bus_mavlink.oracle import KEY, Oracle, dialect, plain, wrapped

FLOATS = [0.0, -0.0, 1.5, -1e30, 1e39, -1e300, math.nan, math.inf, -math.inf, 5e-324]
INTEGERS = [0, 1, -1, 127, 255, 256, 65_535, 1 << 31, (1 << 63) - 1, -(1 << 40) - 12_345]
TEXTS = ["", "a", "RATE_RLL_P", "x" * 300, "\x7f", " ", "%s%n", "0", "-1", "ab" * 8]


def messages(name):
    return list(load_dialect(name).messages.values())


def values_for(kind):
    return TEXTS if kind == "string" else FLOATS if kind.startswith("float") else INTEGERS


def with_value(values, slot, value):
    """Return values with one of them changed as a C program would change it."""
    name, bracket, index = slot.path.partition("[")
    changed = dict(values)
    if slot.kind == "string":
        changed[name] = value.encode()[: slot.size].ljust(slot.size == 1, b"\0")
    elif bracket:
        changed[name] = list(values[name])
        changed[name][int(index[:-1])] = wrapped(slot.kind, value)
    else:
        changed[name] = wrapped(slot.kind, value)
    return changed


@pytest.mark.parametrize("name", dialect_names())
def test_tables_are_those_of_pymavlink(name):
    theirs, ours = dialect(name), load_dialect(name)
    assert set(ours.messages) == set(theirs.mavlink_map)
    for number, kind in theirs.mavlink_map.items():
        message = ours.messages[number]
        assert (message.name, message.crc_extra, message.size) == (kind.msgname, kind.crc_extra, kind.unpacker.size)
        assert list(message.places) == list(kind.fieldnames)
        in_order = sorted(message.places, key=lambda field: message.places[field].offset)
        assert in_order == list(kind.ordered_fieldnames)
        fields = [place.field for place in message.places.values()]
        assert {field.name: field.unit for field in fields if field.unit} == kind.fieldunits_by_name
        assert {field.name: field.enum for field in fields if field.enum} == kind.fieldenums_by_name
        flags = {enum.name for enum in ours.enums.values() if enum.bitmask}
        bitmasks = {field.name for field in fields if field.bitmask or field.enum in flags}
        assert bitmasks == set(kind.fielddisplays_by_name)
    for enum, entries in theirs.enums.items():
        named = {value: entry.name for value, entry in entries.items() if not entry.name.endswith("_ENUM_END")}
        assert {value: entry.name for value, entry in ours.enums[enum].entries.items()} == named


@pytest.mark.parametrize("name", ["all", "ardupilotmega", "common"])
@pytest.mark.parametrize("version", [1, 2])
def test_decode_and_encode(name, version):
    oracle = Oracle(name, version)
    checked = 0
    for message in messages(name):
        if not oracle.knows(message.id):
            assert version == 1
            continue
        for fill in (0, 1, 5):
            raw = oracle.pack(message.id, plain(message, fill))
            kind = MavlinkType(message, {})
            theirs = oracle.unpack(raw)
            ours = {leaf.path: leaf.value for leaf in kind.leaves(raw, elements=255)}
            assert (ours.pop("header.sequence"), ours.pop("header.system_id")) == (200, 17)
            assert ours.pop("header.component_id") == 34
            expected = {}
            for field, value in theirs.items():
                expected |= {f"{field}[{at}]": each for at, each in enumerate(value)} if isinstance(value, list) else {}
                expected |= {} if isinstance(value, list) else {field: value}
            assert ours == expected
            header = 6 if version == 1 else 10
            payload = raw[header : header + raw[1]]
            again = pack_frame(
                message.id, payload, message.crc_extra, version=version, sequence=200, system=17, component=34
            )
            assert again == raw
            checked += 1
    assert checked or version == 1


@pytest.mark.parametrize("version", [1, 2])
def test_patch_each_field_with_ten_values(version):
    _patch_all(messages("all"), Oracle("all", version), signer=None)


def test_patch_signed():
    _patch_all(messages("common"), Oracle("common", key=KEY), signer=Signer(KEY))


def _patch_all(tables: list[MessageTable], oracle: Oracle, signer: Signer | None) -> None:
    draw = random.Random(7)
    patched = 0
    for message in tables:
        if not oracle.knows(message.id):
            continue
        kind = MavlinkType(message, {}, signer=signer)
        known = oracle.module.mavlink_map[message.id].fieldnames
        values = plain(message, draw.choice((0, 3)))
        raw = oracle.pack(message.id, values)
        slots = [slot for path, slot in slots_of(message).items() if path.partition("[")[0] in known]
        for slot in slots:
            if slot.path.endswith("]") and int(slot.path.rpartition("[")[2][:-1]) > 2 and draw.random() < 0.9:
                continue  # elements of an array are much the same
            for value in values_for(slot.kind):
                expected = oracle.pack(message.id, with_value(values, slot, value))
                assert kind.patch(raw, {slot.path: value}) == expected, (message.name, slot.path, value)
                patch = kind.patcher(slot.path, value)
                assert patch is not None
                assert patch(raw) == expected
                patched += 1
    assert patched or not any(oracle.knows(message.id) for message in tables)
