"""Changes of a CDR payload that move what follows: text of another size, and sequences with more or fewer elements.

Bytes before the change stay unchanged, and so do those after it if they move by a multiple of eight bytes. Otherwise
they are copied field by field, with new padding: values that no codec would reproduce, such as text that is not UTF-8
or a boolean of 7, stay unchanged, and so do bytes after the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from riot_bus.types.model import REBUILD, check_size, parse_path, wanted_length
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar
from riot_bus_ros2.cdr_layout import (
    COUNT_LE,
    NOTHING,
    ORIGIN,
    Array,
    Data,
    Node,
    Number,
    Opaque,
    Struct,
    Text,
    Unpack,
    length_of,
    skip_elements,
)


def rebuild(root: Struct, count: Unpack, patch: Callable[[bytes, Mapping[str, Scalar]], bytes],
            payload: bytes, changes: Mapping[str, Scalar]) -> bytes:  # fmt: skip
    """Return the payload with all changes: lengths first, from the outside inwards.

    Args:
        changes: New values by path; all paths are known to exist in the type.

    Raises:
        PayloadError: As `riot_bus.types.model.MessageType.rebuild` says.
        IndexError: The payload ends too early; so do struct.error and OverflowError.
    """
    lengths = {path: wanted_length(value, path) for path, value in changes.items() if parse_path(path).length}
    for path in sorted(lengths, key=lambda each: len(parse_path(each).steps)):
        payload = resized(root, count, payload, path, lengths[path])
    rest = {path: value for path, value in changes.items() if path not in lengths}
    for path, value in rest.items():
        try:
            payload = patch(payload, {path: value})
        except PayloadError as error:
            if error.hint != REBUILD:
                raise
            payload = with_text(root, count, payload, path, str(value).encode(errors="surrogateescape"))
    return payload


def with_text(root: Struct, count: Unpack, payload: bytes, path: str, text: bytes) -> bytes:
    """Return the payload with new text in a string."""
    check_size(len(payload) + len(text), path)
    place = _Place(root, parse_path(path).steps, payload, count)
    writer = _Writer(payload, count, (place.start + 3) & -4)
    writer.text(text)
    return writer.finish(place)


def resized(root: Struct, count: Unpack, payload: bytes, path: str, length: int) -> bytes:
    """Return the payload with `length` elements in a sequence."""
    place = _Place(root, parse_path(path).steps, payload, count)
    array = place.node
    assert isinstance(array, Array)
    before, first = length_of(array, payload, place.start, count)
    if array.length is not None:
        raise PayloadError(f"an array always has {array.length} elements", where=path)
    if before == length:
        return payload
    writer = _Writer(payload, count, (place.start + 3) & -4)
    writer.number(length)
    writer.copy(array.element, first, min(before, length))
    if length > before:
        if before:
            last = skip_elements(array.element, before - 1, payload, first, count)
            writer.repeat(length - before, lambda: writer.copy(array.element, last, 1))
        else:
            writer.repeat(length, lambda: writer.blank(array.element))
    return writer.finish(place)


class _Place:
    """Where a field is, and what follows it.

    Attributes:
        start: Offset at which it may begin, before its padding.
        rest: Nodes that follow, from the inside outwards, each with its number of repetitions.
    """

    def __init__(self, root: Struct, steps: tuple[str | int, ...], data: Data, count: Unpack) -> None:
        node: Node = root
        position = ORIGIN
        outer: list[list[tuple[Node, int]]] = []
        for step in steps:
            if isinstance(node, Struct):
                names = list(node.fields)
                at = names.index(str(step))
                for name in names[:at]:
                    position = node.fields[name].skip(data, position, count)
                outer.append([(node.fields[name], 1) for name in names[at + 1 :]])
                node = node.fields[names[at]]
            else:
                assert isinstance(node, Array)
                index = int(step)
                length, position = length_of(node, data, position, count)
                if index >= length:
                    raise PayloadError(f"no element {index} in a sequence of {length}")
                position = skip_elements(node.element, index, data, position, count)
                outer.append([(node.element, length - index - 1)])
                node = node.element
        self.node, self.start = node, position
        self.end = node.skip(data, position, count)
        if self.end > len(data):
            raise IndexError
        self.rest = [each for level in reversed(outer) for each in level]


class _Writer:
    """Writes a payload from the parts of another one; positions modulo eight determine the padding."""

    def __init__(self, data: bytes, count: Unpack, begin: int) -> None:
        self.data, self.count = data, count
        self.out = bytearray(data[:begin])

    def finish(self, place: _Place) -> bytes:
        """Copy what follows a place."""
        position = place.end
        for node, times in place.rest:
            if not (len(self.out) - position) & 7:
                break
            position = self.copy(node, position, times)
        self.out += self.data[position:]
        check_size(len(self.out))
        return bytes(self.out)

    def copy(self, node: Node, position: int, times: int) -> int:
        """Copy a field `times` times in a row and return where the last one ends in the old payload."""
        if not times or (node.jump is not None and node.jump.first == NOTHING):
            return position
        if not (len(self.out) - position) & 7:
            return self._take(position, skip_elements(node, times, self.data, position, self.count))
        if isinstance(node, Number):
            self.out += bytes(node.padding[len(self.out) & 7])
            position += node.padding[position & 7]
            return self._take(position, position + times * node.size)
        for _ in range(times):
            position = self._copy(node, position)
        return position

    def _copy(self, node: Node, position: int) -> int:
        if isinstance(node, Struct):
            for each in node.fields.values():
                position = self.copy(each, position, 1)
            return position
        if isinstance(node, Opaque):
            raise node.error()
        if isinstance(node, Array):
            length, first = length_of(node, self.data, position, self.count)
            if node.length is None:
                self.number(length)
            return self.copy(node.element, first, length)
        end = node.skip(self.data, position, self.count)
        self._align()
        return self._take((position + 3) & -4, end)

    def repeat(self, times: int, write: Callable[[], object]) -> None:
        """Write an element `times` times; once a position modulo eight recurs, the bytes since then are repeated."""
        out = self.out
        begun: dict[int, tuple[int, int]] = {}
        done = 0
        while done < times:
            before, start = begun.setdefault(len(out) & 7, (done, len(out)))
            if before < done and (whole := (times - done) // (done - before)):
                chunk = out[start:]
                check_size(len(out) + whole * len(chunk))
                out += chunk * whole
                done += whole * (done - before)
            else:
                write()
                done += 1

    def blank(self, node: Node) -> None:
        """Write a field that is zero or empty."""
        check_size(len(self.out))
        if isinstance(node, Text):
            self.text(b"")
        elif node.jump is not None:
            size = node.jump.first[len(self.out) & 7]
            check_size(len(self.out) + size)
            self.out += bytes(size)
        elif isinstance(node, Struct):
            for each in node.fields.values():
                self.blank(each)
        elif isinstance(node, Opaque):
            raise node.error()
        elif isinstance(node, Array) and node.length is not None:
            element = node.element
            self.repeat(node.length, lambda: self.blank(element))
        else:
            self.number(0)

    def text(self, text: bytes) -> None:
        """Write a string."""
        self.number(len(text) + 1)
        self.out += text + b"\0"

    def number(self, value: int) -> None:
        """Write a count."""
        self._align()
        self.out += value.to_bytes(4, "little" if self.count is COUNT_LE else "big")

    def _align(self) -> None:
        self.out += bytes(-len(self.out) & 3)

    def _take(self, start: int, end: int) -> int:
        if end > len(self.data):
            raise IndexError
        self.out += self.data[start:end]
        return end
