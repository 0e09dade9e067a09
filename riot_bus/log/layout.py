"""Encodes and decodes what riot_bus stores in an MCAP file besides messages; docs/log-format.md is for users.

An MCAP message has a channel, two times, a number and data. Other properties of a message on the bus are stored in the
channel if all messages share them, and otherwise in *extras*: one MCAP attachment before each chunk that needs it.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgpack  # type: ignore[import-untyped]
import zstandard

from riot_bus.log.engine.chunk import Companions
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits
from riot_bus.pipeline.event import Change
from riot_bus.types.serve import Request, part_of
from riot_bus.vocabulary.message import Message, Qos, Scalar

Role = Literal["delivered", "original"]

KEY, TOPIC, ROLE, SEGMENT = "riot.key", "riot.topic", "riot.role", "riot.segment"
ENCODING, QOS = "riot.encoding", "riot.qos"
ORIGINAL_PREFIX = "riot/original/"
_CALL_PREFIX = "riot/"
RUN, PROVENANCE = "riot_bus.run", "riot_bus.provenance"
GRAPH = "riot_bus.graph"
LIBRARY = "riot_bus"
_PLAIN_EXTRAS: tuple[tuple[str, str, type], ...] = (
    ("a", "attachment", bytes),
    ("e", "encoding", str),
    ("s", "segment", str),
    ("n", "sequence", int),
    ("r", "parameters", str),
)
_MODEST_COUNT, _MODEST_BYTES = 1 << 15, 1 << 22  # unpacked without checks: 4 MiB of empty maps take 300 MB


@dataclass(frozen=True, slots=True)
class Provenance:
    """What was done to one message: ground truth for everything that is learnt from the log."""

    sequence: int
    key: str
    time: int
    role: Role
    changes: tuple[Change, ...]


@dataclass(frozen=True, slots=True)
class Constants:
    """The properties that a channel's messages have in common."""

    encoding: str = ""
    segment: str = ""
    qos: Qos = field(default_factory=Qos)

    @classmethod
    def of(cls, message: Message) -> Constants:
        """Return the properties of a message."""
        return cls(message.encoding, message.segment, message.qos)

    def to_metadata(self) -> dict[str, str]:
        """Return channel metadata."""
        return {ENCODING: self.encoding, SEGMENT: self.segment, QOS: json.dumps(_qos_list(self.qos))}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> Constants:
        """Read channel metadata of a file from any source."""
        try:
            qos = _qos(json.loads(metadata.get(QOS, "null")))
        except (ValueError, RecursionError):
            qos = Qos()
        return cls(metadata.get(ENCODING, ""), metadata.get(SEGMENT, ""), qos)


def extras_of(message: Message, constants: Constants) -> dict[str, Any] | None:
    """Return the properties of a message that neither MCAP message nor channel can hold, None if there are none."""
    extras: dict[str, Any] = {}
    if message.attachment is not None:
        extras["a"] = message.attachment
    if message.encoding != constants.encoding:
        extras["e"] = message.encoding
    if message.segment != constants.segment:
        extras["s"] = message.segment
    if message.qos is not constants.qos and message.qos != constants.qos:
        extras["q"] = _qos_list(message.qos)
    if message.kind == "delete":
        extras["d"] = True
    published = message.publish_time
    if published is not None and (published == message.time or not 0 <= published < 1 << 64):
        extras["p"] = str(published)
    if not 0 <= message.sequence < 1 << 32:
        extras["n"] = message.sequence
    if isinstance(message, Request) and message.parameters:
        extras["r"] = message.parameters
    return extras or None


def channel_name(topic: str, role: Role) -> str:
    """Return the name of a channel in MCAP; requests and replies get names that are valid for ROS 2 tools."""
    call = part_of(topic)
    if call is not None:
        topic = f"{_CALL_PREFIX}{call[1][1:]}/{call[0].lstrip('/')}"
    return topic if role == "delivered" else ORIGINAL_PREFIX + topic.lstrip("/")


def apply_extras(fields: dict[str, Any], extras: Mapping[str, Any]) -> None:
    """Put extras into the arguments of a `Message`; unknown or damaged ones are left out."""
    for name, attribute, kind in _PLAIN_EXTRAS:
        if isinstance(extras.get(name), kind):
            fields[attribute] = extras[name]
    if "q" in extras:
        fields["qos"] = _qos(extras["q"])
    if extras.get("d") is True:
        fields["kind"] = "delete"
    if isinstance(extras.get("p"), str) and re.fullmatch(r"-?\d{1,20}", extras["p"]):
        fields["publish_time"] = int(extras["p"])


def pack_extras(extras: Sequence[tuple[int, dict[str, Any]]]) -> bytes:
    """Encode the extras of one chunk: pairs of a message's place in the chunk (0, 1, ...) and its extras."""
    return zstandard.compress(msgpack.packb([list(pair) for pair in extras]), 1)


def companions(extras: Sequence[tuple[int, dict[str, Any]]], provenance: Sequence[Provenance]) -> Companions:
    """Return the records that belong to a chunk and stand before it: extras and provenance, if there are any."""
    note = (PROVENANCE, {"changes": pack_provenance(provenance)}) if provenance else None
    return Companions(pack_extras(extras) if extras else b"", note)


def unpack_extras(data: bytes, most: int, limits: LogLimits = DEFAULT_LIMITS) -> dict[int, dict[str, Any]]:
    """Return the extras of one chunk by the message's place in it (0, 1, ...), from data that may be damaged.

    Args:
        data: Result of `pack_extras`.
        most: Largest number of messages that the chunk can have, and so of extras.
        limits: Limits of what is read.

    Raises:
        ValueError: The data are damaged or, as BeyondLimitError, too large.
    """
    try:
        size = zstandard.frame_content_size(data)
        if size < 0:
            raise ValueError("the compressed extras do not state their size")
        limits.check_size(size, len(data))
        raw = zstandard.decompress(data)
        if most <= _MODEST_COUNT and size <= _MODEST_BYTES:
            pairs = msgpack.unpackb(raw, strict_map_key=False, max_array_len=max(most, 3))
        else:
            pairs = _unpack_pairs(raw, most)
        return {int(place): dict(extras) for place, extras in pairs}
    except (zstandard.ZstdError, TypeError, OverflowError, msgpack.UnpackException) as error:
        raise ValueError(str(error)) from error


def _unpack_pairs(raw: bytes, most: int) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the pairs of many extras; refuse deeply nested ones, which would take far more memory than bytes."""
    maps = 0

    def check_list(items: list[Any]) -> list[Any]:
        nonlocal maps
        pair = len(items) == 2 and isinstance(items[0], int) and isinstance(items[1], dict)
        if not pair and not (len(items) == 3 and all(isinstance(each, int | str) for each in items)):
            raise ValueError("not a pair")
        maps = 0 if pair else maps
        return items

    def check_map(mapping: dict[Any, Any]) -> dict[Any, Any]:
        nonlocal maps
        maps += 1
        if maps > 1:
            raise ValueError("nested maps")
        return mapping

    unpacker = msgpack.Unpacker(
        max_buffer_size=len(raw),
        strict_map_key=False,
        max_array_len=3,
        max_map_len=16,
        list_hook=check_list,
        object_hook=check_map,
    )
    unpacker.feed(raw)
    count = unpacker.read_array_header()
    if count > most:
        raise ValueError(f"{count} extras in a chunk of at most {most} messages")
    for _ in range(count):
        yield unpacker.unpack()


def pack_provenance(entries: Sequence[Provenance]) -> str:
    """Encode provenance as JSON text."""
    rows = [
        {
            "sequence": entry.sequence,
            "key": entry.key,
            "time": entry.time,
            "role": entry.role,
            "changes": [
                {
                    "interceptor": change.interceptor,
                    "action": change.action,
                    "field": change.field,
                    "before": _to_json(change.before),
                    "after": _to_json(change.after),
                }
                for change in entry.changes
            ],
        }
        for entry in entries
    ]
    return json.dumps(rows, separators=(",", ":"))


def unpack_provenance(text: str) -> list[Provenance]:
    """Decode the result of `pack_provenance`; raises ValueError if the text is damaged."""
    try:
        return [
            Provenance(
                int(row["sequence"]),
                str(row["key"]),
                int(row["time"]),
                "original" if row["role"] == "original" else "delivered",
                tuple(
                    Change(
                        str(each["interceptor"]),
                        str(each["action"]),
                        each["field"],
                        _from_json(each["before"]),
                        _from_json(each["after"]),
                    )
                    for each in row["changes"]
                ),
            )
            for row in json.loads(text)
        ]
    except (KeyError, TypeError, OverflowError, RecursionError) as error:
        raise ValueError(f"not provenance: {error!r}") from error


def _to_json(value: Scalar | None) -> Any:
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode()}
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    if isinstance(value, str) and not value.isprintable():
        return {"text": base64.b64encode(value.encode("utf-8", "surrogatepass")).decode()}
    return value


def _from_json(value: Any) -> Scalar | None:
    if isinstance(value, dict):
        if "bytes" in value:
            return base64.b64decode(value["bytes"])
        if "text" in value:
            return base64.b64decode(value["text"]).decode("utf-8", "surrogatepass")
        return float(value["float"])
    return value  # type: ignore[no-any-return]


def _qos_list(qos: Qos) -> list[Any]:
    return [qos.priority, qos.congestion, qos.express]


def _qos(value: Any) -> Qos:
    match value:
        case [int(priority), "drop" | "block" | "block_first" as congestion, bool(express)]:
            return Qos(priority, congestion, express)
        case _:
            return Qos()
