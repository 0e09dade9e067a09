"""Exchange of frames as JSON, on the keys of mavlink-server and in the form of mavlink2rest.

    {"header": {"system_id": 1, "component_id": 1, "sequence": 7, "message_id": 0},
     "message": {"type": "HEARTBEAT", "mavtype": {"type": "MAV_TYPE_GCS"}, "base_mode": {"bits": 81}, ...}}

Enum values are names, flags are numbers, text is a string; a field called `type` becomes `mavtype`. NaN and Infinity
are written literally, as in JSON5. An undefined enum value is a plain number, since it has no name.
"""

from __future__ import annotations

import json
import queue
import struct
import threading
from collections import Counter
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import PayloadError, did_you_mean
from riot_bus_bridges.mavlink.sequences import MOST_IDS
from riot_bus_mavlink.frame import Frame, pack_frame, parse_frame
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.slots import CODES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.types.port import Closeable, PortPublisher
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_bridges.host.inner import BridgePort
    from riot_bus_bridges.mavlink.sequences import OwnStreams
    from riot_bus_mavlink.definitions import FieldText, MessageTable
    from riot_bus_mavlink.dialect import Dialect

IN, OUT = "mavlink/in", "mavlink/out"
ENCODING = "application/json;mavlink"
_MARK = b"mavlink-json-1"
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
        """Return the MAVLink 2 frame that JSON describes, missing fields zero; raises PayloadError for other JSON."""
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
    if len(payload) > 1 << 16:
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


class Mirror:
    """Publishes JSON on `mavlink/{sysid}/{compid}/{MESSAGE}` and `mavlink/out`, on a thread of its own.

    Frames that it has no time for are dropped and counted: nothing waits for it.

    Args:
        fields: Whether each field is also published, on `mavlink/{sysid}/{compid}/{MESSAGE}/{field}`.
        insert: Called with frames that others have put on `mavlink/in`; None to accept none.

    Attributes:
        counts: Numbers of frames: `mirrored`, `mirror_lost`, `json_in`, `json_refused`.
    """

    def __init__(
        self,
        port: BridgePort,
        form: JsonForm,
        *,
        fields: bool,
        streams: OwnStreams,
        insert: Callable[[Frame], None] | None,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self._port, self._form, self._fields, self._streams, self._insert = port, form, fields, streams, insert
        self._outlets: dict[str, PortPublisher] = {}
        self._queue: queue.Queue[Sequence[bytes] | None] = queue.Queue(1024)  # batches
        self._inlet: Closeable | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="mavlink-mirror", daemon=True)

    def open(self) -> None:
        """Start publishing and listening."""
        self._thread.start()
        if self._insert is not None:
            self._inlet = self._port.subscribe(IN, partial(self._hear, self._insert))

    def close(self) -> None:
        """Stop soon; frames still in the queue are dropped."""
        if self._inlet is not None:
            self._inlet.close()
        self._ended = True
        with suppress(queue.Full):
            self._queue.put_nowait(None)
        if self._thread.is_alive():
            self._thread.join(5.0)
        for outlet in self._outlets.values():
            outlet.close()

    def offer(self, raws: Sequence[bytes]) -> None:
        """Queue whole frames to be published."""
        try:
            self._queue.put_nowait(raws)
        except queue.Full:
            self.counts["mirror_lost"] += len(raws)

    def _run(self) -> None:
        while (raws := self._queue.get()) is not None and not self._ended:
            for raw in raws:
                try:
                    self._publish(parse_frame(raw))
                except Exception:  # the segment is gone; it may come back
                    self.counts["mirror_lost"] += 1

    def _publish(self, frame: Frame) -> None:
        document = self._form.document(frame)
        if document is None:
            return
        text = json.dumps(document, separators=(",", ":")).encode()
        message = document["message"]
        base = f"mavlink/{frame.system}/{frame.component}/{message['type']}"
        self._outlet(OUT).put(text, _MARK)
        self._outlet(base).put(text, _MARK)
        if self._fields:
            for name, value in message.items():
                self._outlet(f"{base}/{name}").put(json.dumps(value, separators=(",", ":")).encode(), _MARK)
        self.counts["mirrored"] += 1

    def _outlet(self, key: str) -> PortPublisher:
        outlet = self._outlets.get(key)
        if outlet is None:
            if len(self._outlets) >= MOST_IDS:
                self._outlets.pop(next(iter(self._outlets))).close()
            outlet = self._outlets[key] = self._port.publisher(key, reliable=True, encoding=ENCODING)
        return outlet

    def _hear(self, insert: Callable[[Frame], None], payload: bytes, attachment: bytes | None) -> None:
        try:
            frame = self._form.frame(payload, self._streams.next)
        except PayloadError:
            self.counts["json_refused"] += 1
            return
        self.counts["json_in"] += 1
        insert(frame)
