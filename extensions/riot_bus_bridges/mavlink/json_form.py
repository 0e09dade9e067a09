"""Frames as JSON in the form of mavlink2rest and mavlink-server, and back.

    {"header": {"system_id": 1, "component_id": 1, "sequence": 7, "message_id": 0},
     "message": {"type": "HEARTBEAT", "mavtype": {"type": "MAV_TYPE_GCS"}, "base_mode": {"bits": 81}, ...}}

Enum values are names, flags are numbers, text is a string; a field called `type` becomes `mavtype`. NaN and Infinity
are written literally, as in JSON5. An undefined enum value is a plain number, since it has no name.
"""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import PayloadError, did_you_mean
from riot_bus_mavlink.frame import Frame, pack_frame, parse_frame
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.slots import CODES

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.vocabulary.message import Scalar
    from riot_bus_mavlink.definitions import FieldText, MessageTable
    from riot_bus_mavlink.dialect import Dialect

_MOST_BYTES = 1 << 16  # bounds the parser's time; the longest frames make some 3 kB of JSON
_RENAMED = {"type": "mavtype"}


class JsonForm:
    """Writes and reads JSON."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._readers: dict[int, list[tuple[str, Callable[[bytes], Any]]]] = {}

    def document(self, frame: Frame) -> dict[str, Any] | None:
        """Return a frame as JSON values, None if its message is not known."""
        message = self._dialect.messages.get(frame.message_id)
        if message is None:
            return None
        readers = self._readers.get(frame.message_id)
        if readers is None:
            readers = self._readers[frame.message_id] = [
                (_RENAMED.get(name, name), self._reader(place.field, place.offset))
                for name, place in message.places.items()
            ]
        body = frame.payload.ljust(message.size, b"\0")
        header = {
            "system_id": frame.system,
            "component_id": frame.component,
            "sequence": frame.sequence,
            "message_id": frame.message_id,
        }
        return {"header": header, "message": {"type": message.name, **{name: read(body) for name, read in readers}}}

    def frame(self, payload: bytes, sequence: Callable[[int, int], int]) -> Frame:
        """Return the MAVLink 2 frame that JSON describes; missing fields are zero.

        Args:
            payload: JSON text as it was received.
            sequence: Returns the next sequence number of a system and component; the header's is ignored.

        Raises:
            PayloadError: The payload is not JSON of this form, or has unknown names or values that do not fit.
        """
        header, fields = _parts(payload)
        system, component = (_byte(header, name) for name in ("system_id", "component_id"))
        name = fields.pop("type", None)
        message = self._dialect.message(name) if isinstance(name, str) else None
        if message is None:
            known = (each.name for each in self._dialect.messages.values())
            raise PayloadError(f"unknown message {name!r}", hint=did_you_mean(str(name)[:64], known))
        changes = self._changes(message, fields)
        empty = pack_frame(
            message.id,
            bytes(message.size),
            message.crc_extra,
            version=2,
            sequence=sequence(system, component),
            system=system,
            component=component,
        )
        return parse_frame(MavlinkType(message, self._dialect.enums).patch(empty, changes))

    def _reader(self, field: FieldText, offset: int) -> Callable[[bytes], Any]:
        if field.type == "char":
            end = offset + field.size
            return lambda body: body[offset:end].partition(b"\0")[0].decode(errors="replace")
        form = struct.Struct(f"<{field.array or 1}{CODES[field.kind]}")
        if field.array:
            return lambda body: list(form.unpack_from(body, offset))
        table = self._dialect.enums.get(field.enum)
        if table is None:
            return lambda body: form.unpack_from(body, offset)[0]
        if table.bitmask or field.bitmask:
            return lambda body: {"bits": form.unpack_from(body, offset)[0]}
        names = {value: {"type": entry.name} for value, entry in table.entries.items()}

        def read(body: bytes) -> Any:
            value = form.unpack_from(body, offset)[0]
            return names.get(value, value)

        return read

    def _changes(self, message: MessageTable, fields: dict[str, Any]) -> dict[str, Scalar]:
        spelled = {_RENAMED.get(name, name): place.field for name, place in message.places.items()}
        changes: dict[str, Scalar] = {}
        for word, value in fields.items():
            field = spelled.get(word)
            if field is None:
                raise PayloadError("no such field", where=f"{message.name}: {word}", hint=did_you_mean(word, spelled))
            where = f"{message.name}: {word}"
            if field.type == "char":
                changes[field.name] = _text(value, where)
            elif field.array:
                changes |= {f"{field.name}[{index}]": each for index, each in _elements(value, field, where)}
            else:
                changes[field.name] = self._scalar(value, field, where)
        return changes

    def _scalar(self, value: Any, field: FieldText, where: str) -> Scalar:
        if isinstance(value, dict) and len(value) == 1:
            ((kind, value),) = value.items()
            if kind == "type" and isinstance(value, str):
                table = self._dialect.enums.get(field.enum)
                entries = {entry.name: number for number, entry in table.entries.items()} if table else {}
                if value not in entries:
                    raise PayloadError(f"unknown value {value!r}", where=where, hint=did_you_mean(value, entries))
                return entries[value]
        return _number(value, where)


def _parts(payload: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    if len(payload) > _MOST_BYTES:
        raise PayloadError(f"{len(payload)} bytes are too much for one message")
    try:
        document = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise PayloadError(f"not JSON: {error}") from error
    header, message = (document.get(name) if isinstance(document, dict) else None for name in ("header", "message"))
    if not isinstance(header, dict) or not isinstance(message, dict):
        raise PayloadError('not a message: {"header": {...}, "message": {"type": ...}} is expected')
    return header, dict(message)


def _byte(header: dict[str, Any], name: str) -> int:
    value = header.get(name)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 255:
        told = "missing" if value is None else f"{value!r:.100} is not an id"
        raise PayloadError(told, where=f"header: {name}", hint="give a whole number from 0 to 255")
    return value


def _number(value: Any, where: str) -> Scalar:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PayloadError(f"{value!r:.100} is not a number", where=where)
    if isinstance(value, int) and abs(value) >= 1 << 64:
        raise PayloadError("the number is out of range", where=where)
    return value


def _text(value: Any, where: str) -> str:
    """Return text, also from a list of characters or of their codes, as mavlink2rest used to write it."""
    if isinstance(value, list):
        try:
            value = "".join(each if isinstance(each, str) else chr(each) for each in value[:256])
        except (TypeError, ValueError, OverflowError) as error:
            raise PayloadError("not text", where=where) from error
    if not isinstance(value, str):
        raise PayloadError(f"{value!r:.100} is not text", where=where)
    return value.partition("\0")[0]


def _elements(value: Any, field: FieldText, where: str) -> list[tuple[int, Scalar]]:
    if not isinstance(value, list) or len(value) > field.array:
        raise PayloadError(f"not a list of at most {field.array} numbers", where=where)
    return [(index, _number(each, where)) for index, each in enumerate(value)]
