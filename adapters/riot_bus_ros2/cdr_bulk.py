"""One field of many CDR payloads at once: the walk of `cdr_plan`, with arrays for positions.

If a walk meets anything odd (a place beyond the payload, a count that is too large), the payload is left to
`CdrType.read`, which alone decides what decodes. Positions are counted from the beginning of a payload.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.types.payloads import Gathered
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.cdr_layout import ORIGIN, Array, Node, Number, Opaque, Struct, Table, Text
from riot_bus_ros2.cdr_plan import Element

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from riot_bus.types.payloads import Payloads
    from riot_bus_ros2.cdr_plan import Way

    Positions = NDArray[np.int64]
    Mask = NDArray[np.bool_]

_FEW = 32  # fewer payloads than this are walked faster one by one
_FAR = 1 << 40  # largest step over fields of fixed size that cannot overflow int64
_STRIDE = 1 << 30  # times a count of 32 bits it cannot overflow int64
_SHORT = 64  # average number of elements below which arrays are read together
_BATCH = 1 << 14  # payloads of at most `_SHORT` elements on average: index arrays of about 8 MiB


def gather(way: Way, payloads: Payloads) -> Gathered:
    """Return the field at the end of a way for each of n payloads, shape (n,).

    The values have the field's own numpy type; text is an array of str objects, lengths are uint32 (int64 for arrays of
    fixed length).
    """
    values = _blank(way.target, len(payloads))
    valid = np.zeros(len(payloads), np.bool_)
    doubtful = np.ones(len(payloads), np.bool_)
    for rows, walk in _walks(payloads):
        found, ok = _blank(way.target, len(walk.payloads)), np.zeros(len(walk.payloads), np.bool_)
        with suppress(OverflowError):
            found, ok = walk.read(way.target, *walk.locate(way), found)
        values[rows] = found
        valid[rows] = ok
        doubtful[rows] = ~(ok | walk.absent)
    return Gathered(values, valid, doubtful)


def elements(way: Way, payloads: Payloads) -> Iterator[NDArray[Any]]:
    """Yield all elements of an array of numbers, some payloads at a time; damaged payloads are left out."""
    target = way.target
    assert isinstance(target, Array)
    if not isinstance(target.element, Number):
        raise PayloadError("not an array of numbers")
    for _, walk in _walks(payloads):
        with suppress(OverflowError):
            yield from walk.elements(way, target, target.element)


def _walks(payloads: Payloads) -> Iterator[tuple[Any, _Walk]]:
    """Yield a walk over the payloads of each byte order, and where they are among all payloads."""
    if len(payloads.buffer) < ORIGIN or not len(payloads):
        return
    head = _view(payloads.buffer, ">u2")[np.where(payloads.lengths >= ORIGIN, payloads.offsets, 0)]
    for order, encapsulation in (("<", 1), (">", 0)):
        rows: Any = (payloads.lengths >= ORIGIN) & (head == encapsulation)
        if rows.any():
            rows = slice(None) if rows.all() else rows
            yield rows, _Walk(payloads.take(rows), order)


def _blank(target: Node, count: int) -> NDArray[Any]:
    if isinstance(target, Number):
        return np.full(count, np.nan if target.type.startswith("float") else 0, target.type)
    if isinstance(target, Array):
        return np.zeros(count, np.uint32 if target.length is None else np.int64)
    return np.empty(count, np.object_)


def _view(buffer: bytes, dtype: str) -> NDArray[Any]:
    """Return the buffer as if a number began at every byte: element i is the number at byte i."""
    size = np.dtype(dtype).itemsize
    return np.ndarray((max(0, len(buffer) - size + 1),), dtype, buffer, 0, (1,))


class _Walk:
    """Walks over all n payloads in step; where `ok` is false, a position means nothing.

    Positions, counts and `ok` have the shape (n,), or (1,) as long as they are the same for all.

    Attributes:
        absent: Payloads that certainly lack the wanted element: their array is too short.
    """

    def __init__(self, payloads: Payloads, order: str) -> None:
        self.payloads = payloads
        self.absent = np.zeros(len(payloads), np.bool_)
        self._base, self._length = payloads.offsets, _once(payloads.lengths)
        self._order = order
        self._counts = _view(payloads.buffer, order + "u4")

    def locate(self, way: Way) -> tuple[Positions, Mask]:
        """Return the positions at the end of a way."""
        position, ok = np.full(1, ORIGIN, np.int64), np.ones(1, np.bool_)
        for move in way.moves:
            if isinstance(move, Element):
                position, ok = self.enter(move, position, ok)
            else:
                position, ok = self.skip(move, position, ok)
        return position, ok

    def elements(self, way: Way, array: Array, number: Number) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array."""
        position, ok = self.locate(way)
        count, position, ok = self._length_of(array, position, ok)
        position = position + np.where(count > 0, _numbers(number.padding)[position & 7], 0)
        ok = ok & (count > 0) & (position + count * number.size <= self._length)
        count, start, ok = np.broadcast_arrays(count, self._base + position, ok)
        rows = np.flatnonzero(ok)
        if not len(rows):
            return
        count, start = count[rows], start[rows]
        dtype = self._dtype(number)
        buffer = self.payloads.buffer
        if int(count.sum()) > _SHORT * len(rows):
            for at, length in zip(start.tolist(), count.tolist(), strict=True):
                yield np.frombuffer(buffer, dtype, length, at)
            return
        view = _view(buffer, dtype)
        for begin in range(0, len(rows), _BATCH):
            some, first = count[begin : begin + _BATCH], start[begin : begin + _BATCH]
            inside = np.arange(int(some.sum())) - np.repeat(np.cumsum(some) - some, some)
            yield view[np.repeat(first, some) + number.size * inside]

    def skip(self, what: Table | Node, position: Positions, ok: Mask) -> tuple[Positions, Mask]:
        """Return the positions after a field."""
        if isinstance(what, tuple):
            return self._within(position + _numbers(what)[position & 7], ok)
        if what.jump is not None:
            return self.skip(what.jump.first, position, ok)
        if isinstance(what, Text):
            count, position, ok = self._count(position, ok)
            return self._within(position + count, ok)
        if isinstance(what, Array):
            count, position, ok = self._length_of(what, position, ok)
            return self._elements(what.element, count, position, ok)
        if isinstance(what, Opaque):
            return position, np.zeros_like(ok)
        assert isinstance(what, Struct)
        for part in what.parts:
            if not ok.any():  # there may be too many nested messages to visit
                break
            position, ok = self.skip(part, position, ok)
        return position, ok

    def enter(self, element: Element, position: Positions, ok: Mask) -> tuple[Positions, Mask]:
        """Go to an element of an array; payloads that have no such element are not ok."""
        count, position, ok = self._length_of(element.array, position, ok)
        self.absent |= ok & (count <= element.index)
        ok = ok & (count > element.index)
        return self._elements(element.array.element, np.full(1, element.index, np.int64), position, ok)

    def read(self, target: Node, position: Positions, ok: Mask, values: NDArray[Any]) -> tuple[NDArray[Any], Mask]:
        """Return the values at the positions."""
        if isinstance(target, Array):
            _, ok = self.skip(target, position, ok)
            count, _, ok = self._length_of(target, position, ok)
            return self._put(count, ok, values)
        if isinstance(target, Text):
            return self._texts(position, ok, values)
        assert isinstance(target, Number)
        ok = ok & (position + target.size <= self._length)
        if not ok.any():
            return values, ok
        found = _view(self.payloads.buffer, self._dtype(target))[self._places(position, ok)]
        found = found != 0 if target.type == "bool" else found.astype(target.type)
        return self._put(found, ok, values)

    def _dtype(self, number: Number) -> str:
        return "u1" if number.type == "bool" else self._order + np.dtype(number.type).str[1:]

    def _put(self, found: NDArray[Any], ok: Mask, values: NDArray[Any]) -> tuple[NDArray[Any], Mask]:
        """Return the found numbers as values of all payloads."""
        found, ok = np.broadcast_arrays(found, ok)
        np.copyto(values, found, where=ok, casting="unsafe")
        return values, ok

    def _texts(self, position: Positions, ok: Mask, values: NDArray[Any]) -> tuple[NDArray[Any], Mask]:
        count, start, ok = self._count(position, ok)
        ok = ok & (start + count <= self._length)
        buffer = self.payloads.buffer
        begin = np.where(ok, self._base + start, 0)
        end = begin + np.where(ok, count, 0)
        last = np.frombuffer(buffer, np.uint8)[np.maximum(end - 1, 0)]
        ok = ok & ((count == 0) | (last == 0))
        end = end - (count > 0)
        known: dict[bytes, str] = {}
        rows = np.flatnonzero(ok)
        for row, low, high in zip(rows.tolist(), begin[rows].tolist(), end[rows].tolist(), strict=True):
            data = buffer[low:high]
            text = known.get(data)
            if text is None:
                text = known[data] = data.decode(errors="surrogateescape")
            values[row] = text
        return values, ok

    def _count(self, position: Positions, ok: Mask) -> tuple[Positions, Positions, Mask]:
        """Return the count at each position and where it ends."""
        position = (position + 3) & -4
        ok = ok & (position + 4 <= self._length)
        if not ok.any():
            return np.zeros_like(position), position, ok
        counts = _once(self._counts[self._places(position, ok)])
        return counts.astype(np.int64), position + 4, ok

    def _places(self, position: Positions, ok: Mask) -> Positions:
        place = self._base + position
        return place if ok.all() else np.where(ok, place, 0)

    def _length_of(self, array: Array, position: Positions, ok: Mask) -> tuple[Positions, Positions, Mask]:
        if array.length is not None:
            return np.full(1, array.length, np.int64), position, ok
        return self._count(position, ok)

    def _elements(self, node: Node, count: Positions, position: Positions, ok: Mask) -> tuple[Positions, Mask]:
        """Return the positions after `count` elements."""
        if node.jump is not None:
            if node.jump.stride > _STRIDE:
                raise OverflowError
            far = _numbers(node.jump.first)[position & 7] + (count - 1) * node.jump.stride
            return self._within(position + np.where(count > 0, far, 0), ok)
        done = 0
        while (active := ok & (count > done)).any():
            if np.count_nonzero(active) < min(_FEW, len(active)):
                return position, ok & ~active
            further, still = self.skip(node, position, active)
            position = np.where(active, further, position)
            ok = ok & (still | ~active)
            done += 1
        return position, ok

    def _within(self, position: Positions, ok: Mask) -> tuple[Positions, Mask]:
        ok = ok & (position <= self._length)
        return (position if ok.all() else np.where(ok, position, 0)), ok


def _once(numbers: NDArray[Any]) -> NDArray[Any]:
    """Return numbers that are all equal with shape (1,), and others unchanged."""
    return numbers[:1] if len(numbers) and (numbers == numbers[0]).all() else numbers


def _numbers(table: Table) -> NDArray[np.int64]:
    if max(table) > _FAR:
        raise OverflowError
    return np.array(table, np.int64)
