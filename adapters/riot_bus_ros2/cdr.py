"""CDR payloads of ROS 2: an offset walker that reads and patches scalars where they lie.

Source: OMG CDR (formal/02-06-51, 15.3) and DDS-RTPS 10.2 for the encapsulation header. Each primitive is aligned to its
size, counted from after the 4-byte header; strings and sequences begin with a 32-bit count.

What a field of fixed size adds to the position depends only on the position modulo 8, so any run of such fields is one
`Jump`: a table of eight numbers. Arrays of them are crossed in one step, whatever their length.
"""

from __future__ import annotations

import keyword
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.errors import PayloadError, did_you_mean
from riot_bus.types.model import FieldPath, Leaf, Schema, member_path, parse_path, wrap_integer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.trial import Scalar
    from riot_bus_ros2.store import TypeStore

__all__ = ["CdrType"]

_ORIGIN = 4
_CACHED_PLANS = 4096
_MAX_DEPTH = 64
_OUTSIDE = (struct.error, IndexError, OverflowError)  # raised by reading at a place beyond the payload
_PLACEHOLDER = "structure_needs_at_least_one_member"
_PRIMITIVES = {
    "bool": ("bool", "?"), "byte": ("uint8", "B"), "char": ("uint8", "B"), "int8": ("int8", "b"),
    "uint8": ("uint8", "B"), "int16": ("int16", "h"), "uint16": ("uint16", "H"), "int32": ("int32", "i"),
    "uint32": ("uint32", "I"), "int64": ("int64", "q"), "uint64": ("uint64", "Q"), "float32": ("float32", "f"),
    "float64": ("float64", "d"),
}  # fmt: skip

Data = bytes | bytearray
Unpack = Callable[[Data, int], tuple[Any, ...]]
Step = Callable[[Data, int, Unpack], int]
Table = tuple[int, ...]

_COUNT_LE: Unpack = struct.Struct("<I").unpack_from
_COUNT_BE: Unpack = struct.Struct(">I").unpack_from
_NOTHING: Table = (0,) * 8


class _OpaqueError(Exception):
    """A type has something whose place in the bytes is not known here."""


@dataclass(frozen=True, slots=True)
class _Jump:
    """How far fields of fixed size reach: from each position modulo 8 the first time, `stride` each further time.

    The stride is one number: after the first element the position modulo the largest alignment is always the same.
    """

    first: Table
    stride: int

    def over(self, position: int, count: int) -> int:
        return position + self.first[position & 7] + (count - 1) * self.stride if count else position


def _jump(first: Table) -> _Jump:
    return _Jump(first, first[first[0] & 7])


def _then(before: Table, after: Table) -> Table:
    return tuple(step + after[(at + step) & 7] for at, step in enumerate(before))


def _padding(size: int) -> Table:
    return tuple((_ORIGIN - at) & (size - 1) for at in range(8))


class _Number:
    """A primitive."""

    def __init__(self, base: str) -> None:
        self.type, code = _PRIMITIVES[base]
        self.little, self.big = struct.Struct("<" + code), struct.Struct(">" + code)
        self.size = self.little.size
        self.padding = _padding(self.size)
        self.jump: _Jump | None = _jump(tuple(pad + self.size for pad in self.padding))

    def read(self, data: Data, position: int, count: Unpack) -> Scalar:
        value: Scalar = (self.little if count is _COUNT_LE else self.big).unpack_from(data, position)[0]
        return value

    def write(self, data: bytearray, position: int, count: Unpack, value: Scalar) -> None:
        little = count is _COUNT_LE
        if self.type == "bool" and isinstance(value, int):
            struct.pack_into("B", data, position, value & 0xFF)
            return
        try:
            (self.little if little else self.big).pack_into(data, position, self._fit(value))
        except OverflowError:
            (self.little if little else self.big).pack_into(data, position, math.copysign(math.inf, _sign(value)))

    def _fit(self, value: Scalar) -> int | float | bool:
        if isinstance(value, str | bytes):
            raise PayloadError(f"{value!r} is no {self.type}")
        if self.type.startswith("float"):
            return float(value)
        if isinstance(value, float) and not math.isfinite(value):
            raise PayloadError(f"{value} is no {self.type}")
        return wrap_integer(int(value), bits=8 * self.size, signed=self.type.startswith("int"))


class _Text:
    """A string: count of bytes with the terminator, the bytes, a zero."""

    type = "string"
    padding = _padding(4)
    jump: _Jump | None = None

    def read(self, data: Data, position: int, count: Unpack) -> Scalar:
        start, end = self.span(data, position, count)
        return bytes(data[start:end]).decode(errors="surrogateescape")

    def span(self, data: Data, position: int, count: Unpack) -> tuple[int, int]:
        size = count(data, position)[0]
        start = position + 4
        end = start + size
        if end > len(data) or (size and data[end - 1]):
            raise PayloadError(f"string of {size} bytes at byte {position} is not terminated within the payload")
        return start, end - (size > 0)


class _Array:
    """An array of `length` elements, a sequence if `length` is None."""

    def __init__(self, element: _Node, length: int | None) -> None:
        self.element = element
        self.length = length
        inner = element.jump
        self.jump: _Jump | None = None
        if length == 0:
            self.jump = _jump(_NOTHING)
        elif length is not None and inner is not None:
            self.jump = _jump(tuple(inner.over(at, length) - at for at in range(8)))


class _Record:
    """A message: fields in order; `parts` are the same with runs of fixed size joined."""

    def __init__(self, fields: dict[str, _Node]) -> None:
        self.fields = fields
        self.parts: list[Table | _Node] = []
        for node in fields.values():
            if node.jump is None:
                self.parts.append(node)
            elif self.parts and isinstance(self.parts[-1], tuple):
                self.parts[-1] = _then(self.parts[-1], node.jump.first)
            else:
                self.parts.append(node.jump.first)
        only = self.parts[0] if len(self.parts) == 1 else None
        self.jump: _Jump | None = _jump(only) if isinstance(only, tuple) else None


_Node = _Number | _Text | _Array | _Record


@dataclass(frozen=True, slots=True)
class _Plan:
    """How to reach one field: a place known beforehand, steps from there, and what stands at the end."""

    field: FieldPath
    start: int
    steps: tuple[Step, ...]
    target: _Node

    def locate(self, data: Data, count: Unpack) -> int:
        position = self.start
        for step in self.steps:
            position = step(data, position, count)
        return position


class CdrType:
    """One ROS 2 message type in CDR, little- or big-endian.

    Args:
        name: Type name such as `nav_msgs/msg/Odometry`.
        store: Where its definition and those of its parts are found.
        schema: The definition as a log has it; by default written from `store`.
    """

    encoding = "cdr"

    def __init__(self, name: str, store: TypeStore, *, schema: Schema | None = None) -> None:
        self.name = name
        self._store = store
        self._schema = schema
        self._plans: dict[str, _Plan] = {}
        self._root: _Record | None = None
        self._opaque = ""
        try:
            self._root = _compile(name, store, outer=(), done={})
        except _OpaqueError as error:
            self._opaque = str(error)

    @property
    def schema(self) -> Schema:
        """Definition for the log with all dependencies; empty text if the type cannot be written as `ros2msg`."""
        if self._schema is None:
            self._schema = self._store.schema(self.name)
        return self._schema

    @property
    def type_hash(self) -> str:
        """The RIHS01 hash that stands in rmw_zenoh's keys."""
        return self._store.type_hash(self.name)

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the scalar fields in payload order."""
        count = _count_of(payload)
        found: list[Leaf] = []
        try:
            end = _collect(self._layout(), "", payload, _ORIGIN, count, elements, found)
        except _OUTSIDE as error:
            raise self._truncated(payload) from error
        if end > len(payload):
            raise self._truncated(payload)
        return found

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array or sequence)."""
        plan = self._plans.get(path) or self._plan(path)
        count = _count_of(payload)
        target = plan.target
        try:
            position = plan.locate(payload, count)
            if isinstance(target, _Array):
                if _skip(target, payload, position, count) > len(payload):
                    raise self._truncated(payload)
                return _length(target, payload, position, count)[0]
            assert not isinstance(target, _Record)
            return target.read(payload, position, count)
        except _OUTSIDE as error:
            raise self._truncated(payload) from error
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {path}"
            raise

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced in place.

        A string of another length moves what follows: then the message is decoded and encoded anew, which may change
        the padding and drops bytes after the end.
        """
        count = _count_of(payload)
        data = bytearray(payload)
        longer: dict[str, str] = {}
        for path, value in changes.items():
            plan = self._plans.get(path) or self._plan(path)
            target = plan.target
            try:
                position = plan.locate(data, count)
                if isinstance(target, _Number):
                    target.write(data, position, count, value)
                elif isinstance(target, _Text):
                    start, end = target.span(data, position, count)
                    text = _encoded(value)
                    if len(text) == end - start:
                        data[start:end] = text
                    else:
                        longer[path] = str(value)
                else:
                    raise PayloadError("a length cannot be patched in place")
            except _OUTSIDE as error:
                raise self._truncated(payload) from error
            except PayloadError as error:
                error.where = error.where or f"{self.name}: {path}"
                raise
        return self._rebuild(bytes(data), longer) if longer else bytes(data)

    def patcher(self, path: str, value: Scalar) -> Callable[[bytes], bytes] | None:
        """Return what sets a field to always the same value, None unless its place is the same in all payloads.

        Args:
            path: A scalar field.
            value: What it is set to.
        """
        plan = self._plans.get(path) or self._plan(path)
        target = plan.target
        if plan.steps or not isinstance(target, _Number):
            return None
        start, end = plan.start, plan.start + target.size
        data = {}
        for head, count in ((b"\0\1", _COUNT_LE), (b"\0\0", _COUNT_BE)):
            packed = bytearray(target.size)
            target.write(packed, 0, count, value)
            data[head] = bytes(packed)

        def patch(payload: bytes) -> bytes:
            packed = data.get(payload[:2])
            if packed is None or len(payload) < end:
                return self.patch(payload, {path: value})  # says what is wrong
            return b"%b%b%b" % (payload[:start], packed, payload[end:])

        return patch

    def _rebuild(self, payload: bytes, changes: Mapping[str, str]) -> bytes:
        message = self._store.decode(payload, self.name)
        for path, text in changes.items():
            *steps, last = (_python_name(step) for step in parse_path(path).steps)
            owner = message
            for step in steps:
                owner = owner[step] if isinstance(step, int) else getattr(owner, step)
            if isinstance(last, int):
                owner[last] = text
            else:
                setattr(owner, last, text)
        return self._store.encode(message, self.name, little_endian=_count_of(payload) is _COUNT_LE)

    def _layout(self) -> _Record:
        if self._root is None:
            raise PayloadError(f"{self.name} is opaque: {self._opaque}")
        return self._root

    def _plan(self, path: str) -> _Plan:
        try:
            plan = _make_plan(self._layout(), parse_path(path), path)
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {path}"
            raise
        if len(self._plans) >= _CACHED_PLANS:
            self._plans.clear()
        self._plans[path] = plan
        return plan

    def _truncated(self, payload: bytes) -> PayloadError:
        return PayloadError(f"{len(payload)} bytes are too few for {self.name}")


def _count_of(payload: Data) -> Unpack:
    """Return the reader of counts, which also tells the byte order."""
    head = payload[:2]
    if head == b"\0\1":
        return _COUNT_LE
    if head == b"\0\0":
        return _COUNT_BE
    raise PayloadError(f"opaque: encapsulation {head.hex() or 'missing'} is not plain CDR (0000 or 0001)")


def _encoded(value: Scalar) -> bytes:
    if not isinstance(value, str):
        raise PayloadError(f"{value!r} is no string")
    try:
        return value.encode(errors="surrogateescape")
    except UnicodeEncodeError as error:
        raise PayloadError(f"{value!r} cannot be encoded: {error}") from error


def _sign(value: Scalar) -> float:
    return -1.0 if isinstance(value, int | float) and value < 0 else 1.0


def _python_name(step: str | int) -> str | int:
    return f"{step}_" if isinstance(step, str) and keyword.iskeyword(step) else step


def _compile(name: str, store: TypeStore, *, outer: tuple[str, ...], done: dict[str, _Record]) -> _Record:
    if name in done:
        return done[name]
    if name in outer or len(outer) > _MAX_DEPTH:
        raise _OpaqueError(f"type {name} contains itself or is nested deeper than {_MAX_DEPTH}")
    try:
        fields = store.fields(name)
    except KeyError as error:
        raise _OpaqueError(f"type {name} is unknown") from error
    nodes: dict[str, _Node] = {}
    for field in fields:
        node: _Node
        if field.is_message:
            node = _compile(field.content, store, outer=(*outer, name), done=done)
        else:
            node = _base(field.content)
        nodes[field.name] = _Array(node, field.length) if field.is_array else node
    done[name] = _Record(nodes or {_PLACEHOLDER: _Number("uint8")})
    return done[name]


def _base(name: str) -> _Node:
    if name == "string":
        return _Text()
    if name not in _PRIMITIVES:
        raise _OpaqueError(f"{name} is not supported")
    return _Number(name)


def _length(array: _Array, data: Data, position: int, count: Unpack) -> tuple[int, int]:
    """Return how many elements there are and where the first may begin."""
    if array.length is not None:
        return array.length, position
    position = (position + 3) & -4
    return count(data, position)[0], position + 4


def _skip(node: _Node, data: Data, position: int, count: Unpack) -> int:
    """Return where a field ends."""
    if node.jump is not None:
        return position + node.jump.first[position & 7]
    if isinstance(node, _Text):
        return _skip_text(data, position, count)
    if isinstance(node, _Array):
        length, position = _length(node, data, position, count)
        return _skip_elements(node.element, length, data, position, count)
    assert isinstance(node, _Record)
    for part in node.parts:
        if isinstance(part, tuple):
            position += part[position & 7]
        else:
            position = _skip(part, data, position, count)
    return position


def _skip_text(data: Data, position: int, count: Unpack) -> int:
    position = (position + 3) & -4
    return position + 4 + int(count(data, position)[0])


def _skip_elements(node: _Node, number: int, data: Data, position: int, count: Unpack) -> int:
    if node.jump is not None:
        return node.jump.over(position, number)
    for _ in range(number):
        position = _skip(node, data, position, count)
    return position


def _make_plan(root: _Record, field: FieldPath, path: str) -> _Plan:
    node: _Node = root
    route = _Route()
    for step in field.steps:
        if isinstance(node, _Record) and isinstance(step, str):
            if step not in node.fields:
                raise PayloadError(f"no field {step!r}", hint=did_you_mean(step, node.fields))
            for name, each in node.fields.items():
                if name == step:
                    break
                route.skip(each)
            node = node.fields[step]
        elif isinstance(node, _Array) and isinstance(step, int):
            route.enter(node, step)
            node = node.element
        else:
            raise PayloadError(f"no field {step!r} here", hint="elements are written 'name[3]', members 'name.member'")
    if field.length != isinstance(node, _Array):
        kind = "an array" if isinstance(node, _Array) else "no array"
        raise PayloadError(f"{path!r}: this field is {kind}", hint="write 'len(name)' or 'name[3]' for arrays")
    if isinstance(node, _Record):
        raise PayloadError("a message is no scalar field", hint=did_you_mean("", node.fields))
    if not isinstance(node, _Array):
        route.fixed(node.padding)
    return route.plan(field, node)


class _Route:
    """Collects the steps of a plan; joins what is fixed."""

    def __init__(self) -> None:
        self._steps: list[Step] = []
        self._pending = _NOTHING
        self._start: int | None = None

    def fixed(self, table: Table) -> None:
        self._pending = _then(self._pending, table)

    def skip(self, node: _Node) -> None:
        if node.jump is not None:
            self.fixed(node.jump.first)
        else:
            self._add(_skip_text if isinstance(node, _Text) else lambda *at: _skip(node, *at))

    def enter(self, array: _Array, index: int) -> None:
        element, length = array.element, array.length
        if index < 0 or (length is not None and index >= length):
            raise PayloadError(f"no element {index} in an array of {length}")
        if length is None:
            self._add(_element_step(array, index))
        elif element.jump is not None:
            self.fixed(tuple(element.jump.over(at, index) - at for at in range(8)))
        else:
            self._add(lambda *at: _skip_elements(element, index, *at))

    def plan(self, field: FieldPath, target: _Node) -> _Plan:
        self._flush()
        return _Plan(field, self._start if self._start is not None else _ORIGIN, tuple(self._steps), target)

    def _add(self, step: Step) -> None:
        self._flush()
        self._steps.append(step)

    def _flush(self) -> None:
        table, self._pending = self._pending, _NOTHING
        if self._start is None:
            self._start = _ORIGIN + table[_ORIGIN]
        elif table != _NOTHING:
            self._steps.append(lambda _data, position, _count: position + table[position & 7])


def _element_step(array: _Array, index: int) -> Step:
    def step(data: Data, position: int, count: Unpack) -> int:
        length, position = _length(array, data, position, count)
        if index >= length:
            raise PayloadError(f"no element {index} in a sequence of {length}")
        return _skip_elements(array.element, index, data, position, count)

    return step


def _collect(node: _Node, path: str, data: Data, position: int, count: Unpack, elements: int, found: list[Leaf]) -> int:
    """List a field's scalars and return where it ends."""
    if isinstance(node, _Record):
        if node.jump is not None and node.jump.first == _NOTHING:
            return position
        for name, each in node.fields.items():
            if name == _PLACEHOLDER:
                position = _skip(each, data, position, count)
            else:
                position = _collect(each, member_path(path, name), data, position, count, elements, found)
        return position
    if isinstance(node, _Array):
        length, position = _length(node, data, position, count)
        if node.length is None:
            found.append(Leaf(f"len({path})", "uint32", length))
        listed = min(length, max(elements, 0))
        for index in range(listed):
            position = _collect(node.element, f"{path}[{index}]", data, position, count, elements, found)
        return _skip_elements(node.element, length - listed, data, position, count)
    position += node.padding[position & 7]
    found.append(Leaf(path, node.type, node.read(data, position, count)))
    return _skip(node, data, position, count)
