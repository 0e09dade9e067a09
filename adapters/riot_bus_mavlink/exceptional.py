"""Values worth trying in a field, from its definition: enums, markers, units, limits, parameters of commands."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from riot_bus.types.capabilities import SuggestedValue
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_mavlink.units import values_of_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from riot_bus.types.model import MessageType
    from riot_bus_mavlink.definitions import EnumTable, FieldText, MessageTable, Param

_COMMANDS = "MAV_CMD"
_MOST_VALID = 24  # pymavlink's fields use only four enums with more values, which are thinned out
_LIMIT = re.compile(r"(U?)INT(8|16|32|64)_(MAX|MIN)")
_PARAMS = {f"param{number}": number for number in range(1, 8)} | {"x": 5, "y": 6, "z": 7}
_ADDRESSES = frozenset(
    {"header.system_id", "header.component_id", "target_system", "target_component", "target", "sysid", "compid"}
)
_INDICES = re.compile(r"MISSION_\w+")

_Told = tuple[float, str]


def exceptional_values(
    kind: MessageType, message: MessageTable, enums: Mapping[str, EnumTable], payload: bytes, path: str
) -> list[SuggestedValue]:
    """Return what is worth trying in a field of a message.

    Args:
        payload: A sample; it tells which command the parameters belong to.
    """
    name, index = _split(path)
    place = message.places.get(name)
    if place is None:
        return []
    field = place.field
    if field.type == "char":
        return [
            SuggestedValue("A" * field.size, "fills its array, so that no NUL ends it"),
            SuggestedValue("A" * (field.size - 1), "as long as can be with a NUL"),
        ]
    told = [*_of_enum(field, enums), *_of_limits(field.low, field.high), *values_of_unit(field.unit)]
    told += [(value, "the marker for what is not known") for value in invalid_values(field.invalid, index)]
    param = _param(kind, message, enums, payload, name)
    if param is not None:
        told += _of_param(param, enums, field)
    return _fitting(told, field)


def invalid_values(text: str, index: int = 0) -> list[float]:
    """Return the values that an `invalid` marker such as `UINT16_MAX`, `NaN`, `[NaN:]` or `[0,,1]` gives an element.

    >>> invalid_values("UINT16_MAX"), invalid_values("[-1]", 1), invalid_values("[0:]", 1)
    ([65535], [-1], [0])
    """
    inner = text.strip()
    if inner.startswith("["):
        parts = inner.strip("[]").rstrip(":").split(",")
        inner = parts[0] if len(parts) == 1 else parts[index] if index < len(parts) else ""
    inner = inner.strip()
    limit = _LIMIT.fullmatch(inner)
    if limit is not None:
        bits, signed = int(limit[2]), not limit[1]
        if limit[3] == "MIN":
            return [-(1 << (bits - 1)) if signed else 0]
        return [(1 << (bits - signed)) - 1]
    try:
        return [int(inner, 0)]
    except ValueError:
        pass
    try:
        return [float(inner)]
    except ValueError:
        return []


def why_brittle(message: MessageTable, path: str) -> str | None:
    """Return why a field should not be changed, empty if it may be, None if its name is to decide."""
    if path == "header.sequence":
        return "sequence number"
    if path in _ADDRESSES:
        return "address"
    name = path.partition("[")[0]
    place = message.places.get(name)
    if place is None or name == "mavlink_version":
        return None
    if place.field.enum or (name == "seq" and _INDICES.fullmatch(message.name)):
        return ""  # `seq` is the number of an item in a mission
    return "" if name.endswith("_version") or name in ("version", "message_id") else None


def allows_nan(message: MessageTable, path: str) -> bool:
    """Return whether NaN in a field means that its value is not known, or that a parameter is not used.

    The command protocol defines this for the parameters of all commands: https://mavlink.io/en/services/command.html
    """
    name, index = _split(path)
    place = message.places.get(name)
    if place is None or not place.field.kind.startswith("float"):
        return False
    return any(math.isnan(value) for value in invalid_values(place.field.invalid, index)) or (
        name in _PARAMS and _command_of(message) is not None
    )


def _split(path: str) -> tuple[str, int]:
    """Return the name of a field, and the index of an element."""
    name, _, index = path.partition("[")
    return name, int(index[:-1]) if index[:-1].isdecimal() else 0


def _command_of(message: MessageTable) -> str | None:
    """Return the field that tells which command the parameters belong to, None if the message has none."""
    return next((name for name, place in message.places.items() if place.field.enum == _COMMANDS), None)


def _of_enum(field: FieldText, enums: Mapping[str, EnumTable]) -> Iterator[_Told]:
    table = enums.get(field.enum)
    if table is None or not table.entries:
        return
    if table.bitmask or field.bitmask:
        yield from _of_flags(table)
        return
    values = sorted(table.entries)
    for value in values[:: max(1, math.ceil(len(values) / _MOST_VALID))]:
        yield value, table.entries[value].name
    known = set(values)
    gap = next((value + 1 for value in values if value + 1 not in known), values[-1] + 1)
    yield values[0] - 1, f"below all of {field.enum}"
    yield values[-1] + 1, f"above all of {field.enum}"
    yield gap, f"undefined in {field.enum}"
    for value in (127, 255, 65_535, (1 << 31) - 1):
        if value not in known:
            yield value, f"far from all of {field.enum}"


def _of_flags(table: EnumTable) -> Iterator[_Told]:
    flags = table.flags
    yield 0, "no flag"
    yield flags, f"all of {table.name}"
    for value, entry in sorted(table.entries.items()):
        yield value, f"{entry.name} alone"
    free = ~flags & (flags + 1)  # the lowest bit that is not set
    if free < 1 << 64:
        yield free, f"a flag that is not of {table.name}"
    for bits in (8, 16, 32, 64):
        yield (1 << bits) - 1, "all bits"


def _of_limits(low: float | None, high: float | None, step: float = 1) -> Iterator[_Told]:
    if low is not None:
        yield low, "the least that is allowed"
        yield low - step, "less than is allowed"
    if high is not None:
        yield high, "the most that is allowed"
        yield high + step, "more than is allowed"


def _param(
    kind: MessageType, message: MessageTable, enums: Mapping[str, EnumTable], payload: bytes, name: str
) -> Param | None:
    """Return what a parameter means for the command in a payload, None if it is not a parameter."""
    number = _PARAMS.get(name)
    commands = enums.get(_COMMANDS)
    carrier = _command_of(message)
    if number is None or commands is None or carrier is None:
        return None
    try:
        entry = commands.entries.get(int(kind.read(payload, carrier)))
    except PayloadError:
        return None
    return None if entry is None else next((param for param in entry.params if param.index == number), None)


def _of_param(param: Param, enums: Mapping[str, EnumTable], field: FieldText) -> Iterable[_Told]:
    table = enums.get(param.enum)
    if table is not None:
        yield from ((value, entry.name) for value, entry in table.entries.items())
        yield max(table.entries, default=0) + 1, f"undefined in {param.enum}"
    yield from _of_limits(param.low, param.high, param.increment or 1)
    if param.label.lower() in ("latitude", "longitude"):
        yield from values_of_unit("degE7" if field.type == "int32_t" else "deg")
    yield from values_of_unit(param.unit)
    if param.reserved:
        yield 1, "this parameter is reserved"


def _fitting(told: Iterable[_Told], field: FieldText) -> list[SuggestedValue]:
    """Return the values that a field can hold, each once, with the first reason for it."""
    found: dict[object, SuggestedValue] = {}
    for value, reason in told:
        if field.kind.startswith("float"):
            fitted: float = float(value)
        elif not math.isfinite(value):
            continue
        else:
            fitted = round(value)
            bits, signed = 8 * field.size // (field.array or 1), field.kind[0] == "i"
            if not (-(1 << (bits - 1)) if signed else 0) <= fitted < 1 << (bits - signed):
                continue
        found.setdefault("nan" if fitted != fitted else fitted, SuggestedValue(fitted, reason))
    return list(found.values())
