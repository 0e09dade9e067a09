"""The way to one field of a CDR payload: a precomputed fixed part, and steps from place to place for the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from riot_bus.types.model import FieldPath
from riot_bus.vocabulary.errors import PayloadError, did_you_mean
from riot_bus_ros2.cdr_layout import (
    ORIGIN,
    Array,
    Data,
    Node,
    Number,
    Opaque,
    Step,
    Struct,
    Table,
    Text,
    Unpack,
    Varying,
    joined,
    length_of,
    over,
    pass_through,
    skip_elements,
    then,
)

_FEW_PARTS = 64  # grows with the square: 64 parts keep 2,000 moves, 1,000 would keep 500,000


@dataclass(frozen=True, slots=True)
class Element:
    """Move to one element of an array."""

    array: Array
    index: int

    def passing(self, before: Table, after: Table) -> Step:
        """Return the step to it, including the runs before the array and after the skipped elements."""
        array, index, jump = self.array, self.index, self.array.element.jump

        def step(data: Data, position: int, count: Unpack) -> int:
            length, position = length_of(array, data, position + before[position & 7], count)
            if index >= length:
                raise PayloadError(f"no element {index} in a sequence of {length}")
            position = skip_elements(array.element, index, data, position, count)
            return position + after[position & 7]

        if jump is None:
            return step
        far = then(tuple(jump.over(at, index) - at for at in range(8)), after)

        def quick(data: Data, position: int, count: Unpack) -> int:
            length, position = length_of(array, data, position + before[position & 7], count)
            if index >= length:
                raise PayloadError(f"no element {index} in a sequence of {length}")
            return position + far[position & 7]

        return quick


Move = Table | Varying | Element
"""One part of a way: add a table's entry, skip a field, or go to an element."""


@dataclass(frozen=True, slots=True)
class Way:
    """The moves from the beginning of any payload to one field, and the field's node."""

    moves: tuple[Move, ...]
    target: Node


@dataclass(frozen=True, slots=True)
class FieldPlan:
    """Plan to reach one field: a precomputed place, the steps from there, and the field's node."""

    start: int
    steps: tuple[Step, ...]
    target: Node
    way: Way

    def locate(self, data: Data, count: Unpack) -> int:
        """Return where the field begins."""
        position = self.start
        for step in self.steps:
            position = step(data, position, count)
        return position


def find_way(root: Struct, field: FieldPath, path: str) -> Way:
    """Return the way to a field; raises PayloadError if the type has no such field, or none that can be reached."""
    node: Node = root
    moves: list[Move] = []
    for step in field.steps:
        if isinstance(node, Struct) and isinstance(step, str):
            if step not in node.fields:
                raise PayloadError(f"no field {step!r}", hint=did_you_mean(step, node.fields))
            moves += _before(node, step)
            node = node.fields[step]
        elif isinstance(node, Array) and isinstance(step, int):
            moves.append(_element(node, step))
            node = node.element
        else:
            raise PayloadError(f"no field {step!r} here", hint="elements are written 'name[3]', members 'name.member'")
    if field.length != isinstance(node, Array):
        kind = "an array" if isinstance(node, Array) else "no array"
        raise PayloadError(f"{path!r}: this field is {kind}", hint="write 'len(name)' or 'name[3]' for arrays")
    if isinstance(node, Struct):
        raise PayloadError("a message is not a scalar field", hint=did_you_mean("", node.fields))
    opaque = next((each for each in (*moves, node) if isinstance(each, Opaque)), None)
    if opaque is not None:
        raise opaque.error()
    if isinstance(node, Number | Text):
        moves.append(node.padding)
    return Way(tuple(joined(moves)), node)


def make_plan(way: Way) -> FieldPlan:
    """Return the steps of a way for one payload at a time."""
    moves = list(way.moves)
    start = ORIGIN
    if moves and isinstance(moves[0], tuple):
        start += moves[0][ORIGIN]
        del moves[0]
    return FieldPlan(start, tuple(pass_through(moves)), way.target, way)


def _before(record: Struct, name: str) -> Sequence[Move]:
    """Return the moves over the fields before the named one; cached for all fields unless the record has many parts."""
    if len(record.parts) > _FEW_PARTS:
        found: list[Move] = []
        for other, node in record.fields.items():
            if other == name:
                return found
            found.append(over(node))
    if not record.before:
        moves: tuple[Move, ...] = ()
        for other, node in record.fields.items():
            record.before[other] = moves
            moves = tuple(joined([*moves, over(node)]))
    return record.before[name]


def _element(array: Array, index: int) -> Move:
    length, jump = array.length, array.element.jump
    if index < 0 or (length is not None and index >= length):
        raise PayloadError(f"no element {index} in an array of {length}")
    if length is None or jump is None:
        return Element(array, index)
    return tuple(jump.over(at, index) - at for at in range(8))
