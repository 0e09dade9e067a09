"""CDR layout of a ROS 2 type: what a field of fixed size adds to a position, and where fields of variable size end.

Source: OMG CDR (formal/02-06-51, 15.3) and DDS-RTPS 10.2 for the encapsulation header. Each primitive is aligned to its
size, counted from after the 4-byte header; strings and sequences begin with a 32-bit count.

What a field of fixed size adds to the position depends only on the position modulo 8, so any run of such fields is one
`Jump`: a table of eight numbers. Arrays of them are crossed in one step, whatever their length. A field of variable
size is skipped in one call together with the tables before and after it, since calls cost the most.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from riot_bus.types.model import MAX_DEPTH, wrap_integer
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.hashes import PLACEHOLDER

if TYPE_CHECKING:
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_ros2.store import TypeStore

ORIGIN = 4
OUTSIDE = (struct.error, IndexError, OverflowError)
"""Raised by reading at a place beyond the payload."""
PRIMITIVES = {
    "bool": ("bool", "?"), "byte": ("uint8", "B"), "char": ("uint8", "B"), "int8": ("int8", "b"),
    "uint8": ("uint8", "B"), "int16": ("int16", "h"), "uint16": ("uint16", "H"), "int32": ("int32", "i"),
    "uint32": ("uint32", "I"), "int64": ("int64", "q"), "uint64": ("uint64", "Q"), "float32": ("float32", "f"),
    "float64": ("float64", "d"),
}  # fmt: skip
"""Our name and the letter of `struct` of each type of number."""

Data = bytes | bytearray
Unpack = Callable[[Data, int], tuple[Any, ...]]
Step = Callable[[Data, int, Unpack], int]
Table = tuple[int, ...]

COUNT_LE: Unpack = struct.Struct("<I").unpack_from
COUNT_BE: Unpack = struct.Struct(">I").unpack_from
NOTHING: Table = (0,) * 8  # 0 bytes from each position modulo 8, the largest alignment


@dataclass(frozen=True, slots=True)
class Jump:
    """Size of fields of fixed size: by position modulo 8 for the first element, `stride` for each further one.

    One stride is enough: after the first element, the position modulo the largest alignment is always the same.
    """

    first: Table
    stride: int

    def over(self, position: int, count: int) -> int:
        """Return the position after `count` elements."""
        return position + self.first[position & 7] + (count - 1) * self.stride if count else position


def _jump(first: Table) -> Jump:
    return Jump(first, first[first[0] & 7])


def then(before: Table, after: Table) -> Table:
    """Return what two consecutive runs of fields of fixed size add to a position."""
    return tuple(step + after[(at + step) & 7] for at, step in enumerate(before))


def _padding(size: int) -> Table:
    return tuple((ORIGIN - at) & (size - 1) for at in range(8))


_TO_COUNT = _padding(4)


def pass_table(table: Table) -> Step:
    """Return the step that adds what a table says."""
    return lambda _data, position, _count: position + table[position & 7]


class Number:
    """A primitive."""

    listed = True

    def __init__(self, base: str) -> None:
        self.type, code = PRIMITIVES[base]
        self.little, self.big = struct.Struct("<" + code), struct.Struct(">" + code)
        self.size = self.little.size
        self.padding = _padding(self.size)
        self.jump = _jump(tuple(pad + self.size for pad in self.padding))
        self.skip = pass_table(self.jump.first)

    def read(self, data: Data, position: int, count: Unpack) -> Scalar:
        """Return the number at this place; `count` tells the byte order."""
        value: Scalar = (self.little if count is COUNT_LE else self.big).unpack_from(data, position)[0]
        return value

    def pack(self, count: Unpack, value: Scalar) -> bytes:
        """Return the bytes of a number; integers wrap, floats that overflow become infinite."""
        if self.type == "bool" and isinstance(value, int):
            return bytes((value & 0xFF,))
        order = self.little if count is COUNT_LE else self.big
        if isinstance(value, str | bytes):
            raise PayloadError(f"{value!r} is not of type {self.type}")
        if self.type.startswith("float"):
            try:
                return order.pack(float(value))
            except OverflowError:
                return order.pack(math.inf if value > 0 else -math.inf)
        if isinstance(value, float) and not math.isfinite(value):
            raise PayloadError(f"{value} is not of type {self.type}")
        return order.pack(wrap_integer(int(value), bits=8 * self.size, signed=self.type.startswith("int")))


class Text:
    """A string: count of bytes with the terminator, the bytes, a zero.

    Args:
        most: Upper bound of its bytes; 0 if there is none. Payloads are not checked against it.
    """

    type = "string"
    listed = True
    padding = _padding(4)
    jump: Jump | None = None

    def __init__(self, most: int = 0) -> None:
        self.most = most
        self.skip = self.passing(NOTHING, NOTHING)

    @staticmethod
    def passing(before: Table, after: Table) -> Step:
        """Return the step over a string and the runs before and after it."""
        before = then(before, _TO_COUNT)

        def step(data: Data, position: int, count: Unpack) -> int:
            position += before[position & 7]
            position += 4 + count(data, position)[0]
            return position + after[position & 7]

        return step

    def read(self, data: Data, position: int, count: Unpack) -> Scalar:
        """Return the text; bytes that are not UTF-8 become surrogates."""
        start, end = self.span(data, position, count)
        return bytes(data[start:end]).decode(errors="surrogateescape")

    def span(self, data: Data, position: int, count: Unpack) -> tuple[int, int]:
        """Return start and end of the text, without its terminator."""
        size = count(data, position)[0]
        start = position + 4
        end = start + size
        if end > len(data) or (size and data[end - 1]):
            raise PayloadError(f"string of {size} bytes at byte {position} is not terminated within the payload")
        return start, end - (size > 0)


class Opaque:
    """A part of unknown size, which cannot be skipped; `reason` says why."""

    listed = True
    jump: Jump | None = None

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def error(self) -> PayloadError:
        """Return the error to raise where the part would have to be skipped."""
        return PayloadError(f"opaque: {self.reason}")

    def skip(self, data: Data, position: int, count: Unpack) -> int:
        """Raise the error."""
        del data, position, count
        raise self.error()

    def passing(self, before: Table, after: Table) -> Step:
        """Return the step that raises the error."""
        del before, after
        return self.skip


class Array:
    """An array of `length` elements, a sequence if `length` is None; then `most` is its upper bound, 0 without one."""

    def __init__(self, element: Node, length: int | None, most: int = 0) -> None:
        self.element = element
        self.length = length
        self.most = most
        self.listed: bool = length is None or (length > 0 and element.listed)
        inner = element.jump
        self.jump: Jump | None = None
        if length == 0:
            self.jump = _jump(NOTHING)
        elif length is not None and inner is not None:
            self.jump = _jump(tuple(inner.over(at, length) - at for at in range(8)))
        self.skip = self.passing(NOTHING, NOTHING) if self.jump is None else pass_table(self.jump.first)

    def passing(self, before: Table, after: Table) -> Step:
        """Return the step over the array, which has no fixed size, and the runs before and after it."""
        length, jump, one = self.length, self.element.jump, self.element.skip
        if length is not None:

            def array(data: Data, position: int, count: Unpack) -> int:
                position += before[position & 7]
                for _ in range(length):
                    position = one(data, position, count)
                return position + after[position & 7]

            return array
        before = then(before, _TO_COUNT)
        if jump is None:

            def sequence(data: Data, position: int, count: Unpack) -> int:
                position += before[position & 7]
                number: int = count(data, position)[0]
                position += 4
                for _ in range(number):
                    position = one(data, position, count)
                return position + after[position & 7]

            return sequence
        first, stride = jump.first, jump.stride

        def numbers(data: Data, position: int, count: Unpack) -> int:
            position += before[position & 7]
            number: int = count(data, position)[0]
            position += 4
            if number:
                position += first[position & 7] + (number - 1) * stride
            return position + after[position & 7]

        return numbers


class Struct:
    """A message: fields in order; `parts` are the same with runs of fixed size joined.

    `before` is used by the search for ways to fields; `listed` says whether there is a field, here or inside of these.
    """

    def __init__(self, name: str, fields: dict[str, Node]) -> None:
        self.name = name
        self.fields = fields
        self.listed: bool = any(name != PLACEHOLDER and node.listed for name, node in fields.items())
        self.before: dict[str, tuple[Any, ...]] = {}
        moves: list[Table | Varying] = [over(node) for node in fields.values()]
        self.parts = joined(moves)
        first, *rest = self.parts or [NOTHING]
        self.jump: Jump | None = _jump(first) if isinstance(first, tuple) and not rest else None
        self._steps = pass_through(self.parts)  # made once: a type may occur in another one very often
        self.skip = self._steps[0] if len(self._steps) == 1 else self.passing(NOTHING, NOTHING)

    def passing(self, before: Table, after: Table) -> Step:
        """Return the step over the message and the runs before and after it."""
        steps = self._steps

        def step(data: Data, position: int, count: Unpack) -> int:
            position += before[position & 7]
            for each in steps:
                position = each(data, position, count)
            return position + after[position & 7]

        return step


Varying = Text | Array | Struct | Opaque
"""Nodes that may have no fixed size."""
Node = Number | Varying
MoveT = TypeVar("MoveT")


class Passed(Protocol):
    """A part without fixed size that can be skipped."""

    def passing(self, before: Table, after: Table) -> Step:
        """Return the step over it and the runs before and after it."""
        ...


def compile_type(name: str, store: TypeStore, *, outer: tuple[str, ...], done: dict[str, Struct]) -> Struct | Opaque:
    """Return the layout of a type; parts that are unknown or not supported are opaque.

    Args:
        outer: The types that it is nested in.
        done: Finished layouts by name, to which new ones are added.
    """
    if name in done:
        return done[name]
    if name in outer or len(outer) > MAX_DEPTH:
        return Opaque(f"type {name} contains itself or is nested deeper than {MAX_DEPTH}")
    try:
        fields = store.fields(name)
    except KeyError:
        return Opaque(f"type {name} is unknown")
    nodes: dict[str, Node] = {}
    for field in fields:
        node: Node
        if field.is_message:
            node = compile_type(field.content, store, outer=(*outer, name), done=done)
        elif field.content == "string":
            node = Text(field.most_bytes)
        elif field.content in PRIMITIVES:
            node = Number(field.content)
        else:  # vendors do not agree on the size of characters, nor on the alignment of long doubles
            node = Opaque(f"{field.content} is not supported ({name}: {field.name})")
        nodes[field.name] = Array(node, field.length, field.most) if field.is_array else node
    done[name] = Struct(name, nodes or {PLACEHOLDER: Number("uint8")})
    return done[name]


def over(node: Node) -> Table | Varying:
    """Return what a field adds to a position, or the field itself if that depends on the payload."""
    if isinstance(node, Number):
        return node.jump.first
    return node if node.jump is None else node.jump.first


def joined(moves: Iterable[MoveT]) -> list[MoveT]:
    """Return the moves with adjacent tables joined, and without tables that add nothing."""
    found: list[Any] = []
    for move in moves:
        last = found[-1] if found else None
        if isinstance(move, tuple) and isinstance(last, tuple):
            found[-1] = then(last, move)
        else:
            found.append(move)
    return [move for move in found if move != NOTHING]


def pass_through(moves: Iterable[Table | Passed]) -> list[Step]:
    """Return the steps for all moves; tables are joined with the neighbouring fields of variable size."""
    found: list[Step] = []
    before, pending = NOTHING, None
    for move in joined(moves):
        if not isinstance(move, tuple):
            if pending is not None:
                found.append(pending.passing(before, NOTHING))
                before = NOTHING
            pending = move
        elif pending is None:
            before = move
        else:
            found.append(pending.passing(before, move))
            before, pending = NOTHING, None
    if pending is not None:
        found.append(pending.passing(before, NOTHING))
    elif before != NOTHING:
        found.append(pass_table(before))
    return found


def length_of(array: Array, data: Data, position: int, count: Unpack) -> tuple[int, int]:
    """Return how many elements there are and where the first may begin."""
    if array.length is not None:
        return array.length, position
    position = (position + 3) & -4
    return count(data, position)[0], position + 4


def skip_elements(node: Node, number: int, data: Data, position: int, count: Unpack) -> int:
    """Return where `number` elements end."""
    if node.jump is not None:
        return node.jump.over(position, number)
    for _ in range(number):
        position = node.skip(data, position, count)
    return position
