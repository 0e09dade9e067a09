"""Interfaces of message types, independent of the encoding, and of adapters."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol, runtime_checkable

from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

MOST_BYTES = 1 << 26
"""Largest size to which a payload may grow, in bytes."""

MOST_LEAVES = 1 << 17
"""Most fields that are listed of a payload, unless more elements are wanted of each array: `riot show` takes 2.5 s for
so many. With 16 elements of each array, messages of 161 of the 163 types of Kilted are within it at any length."""

MAX_DEPTH = 64
"""Deepest nesting of values and types: at one or two calls for each level far below Python's limit of 1000."""

REBUILD = "`patch` cannot change the size of the payload: use `rebuild`"
"""Hint of errors for changes that `MessageType.patch` rejects but `MessageType.rebuild` supports."""

ROOT = "value"
"""Path of the whole payload if it is not a map: `value`, `value[3]`, `len(value)`."""

_LONGEST_PATH = 1 << 10  # else many fields inside of one with a name of 1 MB would have paths of GBs
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_INDEX = re.compile(r"\[\d+\]")
_STEP = re.compile(r'(?:^|\.)([A-Za-z_][A-Za-z0-9_]*)|\[(-?[0-9]{1,20})\]|\[("(?:[^"\\]|\\.)*")\]')


@dataclass(frozen=True, slots=True)
class Leaf:
    """One scalar field of one payload.

    `type` is one of bool, int8 ... uint64, float32, float64, string, bytes.
    """

    path: str
    type: str
    value: Scalar


@dataclass(frozen=True, slots=True)
class Schema:
    """A type's definition as MCAP stores it: name, encoding (`ros2msg`, `jsonschema`, ...) and text."""

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class TopicName:
    """The topic name of a key, and the message type that the key contains, if any."""

    name: str
    type_name: str | None = None


@runtime_checkable
class MessageType(Protocol):
    """Reads and changes the payloads of one type; hostile bytes never raise anything but `PayloadError`."""

    @property
    def name(self) -> str:
        """Name of the type, such as `nav_msgs/msg/Odometry` or `json`."""

    @property
    def encoding(self) -> str:
        """MCAP message encoding: `cdr`, `json`, `msgpack`."""

    @property
    def schema(self) -> Schema | None:
        """Definition for the log, None if the encoding is self-describing."""

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the scalar fields in payload order.

        Args:
            payload: Payload of one message.
            elements: Largest number of elements listed of each array or sequence; sequences of variable length also
                have the pseudo-field `len(path)`.

        Raises:
            PayloadError: The payload is opaque.
        """

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded, None if it can; never raise.

        If there is a reason, `leaves` raises it. `why_opaque` is an implementation for any type.
        """

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for a length).

        Raises:
            PayloadError: There is no such field.
        """

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced in place; every other byte stays as it is.

        Integers outside the type's range wrap to its bit width; floats that overflow become infinite.

        Raises:
            PayloadError: There is no such field, the value is of another kind, or it does not fit in place; in the
                last case, use `rebuild`.
        """

    def rebuild(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with changed fields, which may change its size; values that fit are patched in place.

        In addition to `patch`, it supports text and bytes of any size, and lengths of sequences (`len(path)`), which
        are changed before scalars. Elements are removed or added at the end; new ones repeat the last one, and are zero
        or empty if there was none. Bounds that the type declares are not enforced.

        Raises:
            PayloadError: There is no such field, the value is of another kind, or the result exceeds `MOST_BYTES`.
        """


@runtime_checkable
class TypeSource(Protocol):
    """A source of types by name and by log schema: an adapter, or an encoding whose types are defined separately."""

    name: str

    def load(self, files: Sequence[Path]) -> None:
        """Load type definitions that the user named; raise ConfigError with the place of an error."""

    def type_named(self, type_name: str) -> MessageType | None:
        """Return the type of this name, None if unknown."""

    def type_of_schema(self, schema: Schema) -> MessageType | None:
        """Return a type from a log's schema, None if it is of another kind or cannot be parsed."""


class Adapter(TypeSource, Protocol):
    """Support for a middleware or protocol: names of topics and types of messages.

    Optional capabilities are in `riot_bus.types.capabilities`. A class with the attribute `on_request = True` is loaded
    only if the user names it.
    """

    def topic(self, key: str) -> TopicName | None:
        """Return the topic name of a key, None if the key does not belong to this adapter."""

    def key_expression(self, topic: str) -> str | None:
        """Return the key expression of a topic name, None if the name does not belong to this adapter."""


def why_opaque(kind: MessageType, payload: bytes) -> str | None:
    """Return why a payload cannot be decoded, None if it can: a slow implementation of `MessageType.opaque`."""
    try:
        kind.leaves(payload)
    except PayloadError as error:
        return error.message
    return None


def wanted_length(value: Scalar, path: str) -> int:
    """Return a value that is meant as a length; raise PayloadError if it is not a valid one."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1 << 32:
        raise PayloadError(f"{value!r} is not a length", where=path, hint="write an integer from 0 to 4294967295")
    return value


def rebuilt(
    payload: bytes,
    changes: Mapping[str, Scalar],
    resize: Callable[[bytes, str, int], bytes],
    patch: Callable[[bytes, Mapping[str, Scalar]], bytes],
) -> bytes:
    """Return a payload with changed fields; lengths are changed before scalars, which may be in new elements.

    Args:
        payload: Payload of one message.
        changes: New values by path, as in `MessageType.rebuild`.
        resize: Function of the payload, the path of a length, and the new length.
        patch: Function that changes scalars.
    """
    scalars = {}
    for path, value in changes.items():
        if parse_path(path).length:
            payload = resize(payload, path, wanted_length(value, path))
        else:
            scalars[path] = value
    return patch(payload, scalars) if scalars else payload


def encoded_text(value: str, path: str | None = None) -> bytes:
    """Return text as UTF-8, with bytes in place of surrogates that stand for them; raise PayloadError for others."""
    try:
        return value.encode(errors="surrogateescape")
    except UnicodeEncodeError as error:
        raise PayloadError(f"{value!r} cannot be encoded: {error}", where=path) from error


def saturated(value: float) -> float:
    """Return a number as a float; an integer that overflows becomes infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def packed_float(form: str, value: float) -> bytes:
    """Return a number in a floating-point format of `struct`; one that overflows becomes infinite."""
    try:
        return struct.pack(form, float(value))
    except OverflowError:
        return struct.pack(form, math.inf if value > 0 else -math.inf)


def check_size(size: int, path: str = "") -> None:
    """Raise PayloadError if a payload would get too large."""
    if size > MOST_BYTES:
        raise PayloadError(f"a payload of {size} bytes is over the limit of {MOST_BYTES}", where=path or None)


def check_leaves(count: int, elements: int) -> None:
    """Raise PayloadError if too many fields have been listed; `elements` are wanted of each array."""
    most = max(MOST_LEAVES, 4 * elements)  # such as x, y, z and intensity of all points that `set_field` may set
    if count > most:
        raise PayloadError(f"opaque: more than {most} fields", hint="name the fields: they can be read one by one")


@dataclass(frozen=True, slots=True)
class FieldPath:
    """A parsed field path: member names and element numbers, and whether the length of that field is meant."""

    steps: tuple[str | int, ...]
    length: bool = False


@lru_cache(maxsize=4096)
def parse_path(path: str) -> FieldPath:
    """Parse `pose.position.x`, `ranges[3]`, `len(ranges)` or `["odd key"].x`.

    Raises:
        PayloadError: The text is not the path of one field.
    """
    length = path.startswith("len(") and path.endswith(")")
    body = path[4:-1] if length else path
    steps: list[str | int] = []
    position = 0
    while position < len(body):
        match = _STEP.match(body, position)
        if match is None:
            raise PayloadError(f"{path!r} is not a field path", hint="write it like 'pose.position.x' or 'ranges[3]'")
        name, index, quoted = match.groups()
        steps.append(name if name is not None else int(index) if index is not None else _unquote(quoted, path))
        position = match.end()
    if not steps:
        raise PayloadError(f"{path!r} names no field")
    return FieldPath(tuple(steps), length)


def _unquote(text: str, path: str) -> str:
    try:
        return str(json.loads(text))
    except ValueError as error:
        raise PayloadError(f"{text} in {path!r} is not a quoted key") from error


@lru_cache(1 << 12)  # each message has the same fields
def member_path(parent: str, key: str | int) -> str:
    """Return the path of a member: `a[3]` for a number; texts that are not identifiers are quoted: `a["odd key"]`."""
    if len(parent) > _LONGEST_PATH or (isinstance(key, str) and len(key) > _LONGEST_PATH):
        raise PayloadError(f"opaque: a field's path has more than {_LONGEST_PATH} characters")
    if isinstance(key, int):
        return f"{parent}[{key}]"
    if _NAME.fullmatch(key) is None:
        return f"{parent}[{json.dumps(key, ensure_ascii=False)}]"
    return f"{parent}.{key}" if parent else key


def family_of(path: str) -> str:
    """Return a path with `[*]` for each index, which all elements of an array share."""
    return _INDEX.sub("[*]", path)


def wrap_integer(value: int, *, bits: int, signed: bool) -> int:
    """Return an integer wrapped to `bits` bits (two's complement if signed)."""
    value &= (1 << bits) - 1
    return value - (1 << bits) if signed and value >> (bits - 1) else value
