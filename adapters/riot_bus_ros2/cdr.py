"""CDR payloads of ROS 2: an offset walker that reads and patches scalars where they lie."""

from __future__ import annotations

import keyword
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from riot_bus.errors import PayloadError
from riot_bus.types.model import Leaf, Schema, member_path, parse_path
from riot_bus_ros2.cdr_fields import list_fields
from riot_bus_ros2.cdr_layout import (
    COUNT_BE,
    COUNT_LE,
    NOTHING,
    ORIGIN,
    OUTSIDE,
    PLACEHOLDER,
    Array,
    Data,
    Node,
    Number,
    OpaqueError,
    Record,
    Text,
    Unpack,
    compile_type,
    length_of,
    skip,
    skip_elements,
)
from riot_bus_ros2.cdr_plan import Plan, Way, find_way, make_plan

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from riot_bus.trial import Scalar
    from riot_bus.types.bulk import Gathered, Payloads
    from riot_bus.types.fields import FieldType
    from riot_bus_ros2.store import TypeStore

__all__ = ["CdrType"]

_CACHED_PLANS = 4096


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
        self._plans: dict[str, Plan] = {}
        self._root: Record | None = None
        self._opaque = ""
        try:
            self._root = compile_type(name, store, outer=(), done={})
        except OpaqueError as error:
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
            end = _collect(self._layout(), "", payload, ORIGIN, count, elements, found)
        except OUTSIDE as error:
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
            if isinstance(target, Array):
                if skip(target, payload, position, count) > len(payload):
                    raise self._truncated(payload)
                return length_of(target, payload, position, count)[0]
            assert not isinstance(target, Record)
            return target.read(payload, position, count)
        except OUTSIDE as error:
            raise self._truncated(payload) from error
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {path}"
            raise

    def gather(self, payloads: Payloads, path: str) -> Gathered:
        """Return one field of many payloads at once, as `riot_bus.types.bulk.BulkType` says."""
        from riot_bus_ros2.cdr_bulk import gather

        return gather(self._way(path), payloads)

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array of numbers, as `riot_bus.types.fields.Described` says."""
        from riot_bus_ros2.cdr_bulk import elements

        return elements(self._way(f"len({path})"), payloads)

    def fields(self) -> Sequence[FieldType]:
        """List the fields that messages of this type have, in payload order."""
        return list_fields(self._layout())

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
                if isinstance(target, Number):
                    target.write(data, position, count, value)
                elif isinstance(target, Text):
                    start, end = target.span(data, position, count)
                    text = _encoded(value)
                    if len(text) == end - start:
                        data[start:end] = text
                    else:
                        longer[path] = str(value)
                else:
                    raise PayloadError("a length cannot be patched in place")
            except OUTSIDE as error:
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
        if plan.steps or not isinstance(target, Number):
            return None
        start, end = plan.start, plan.start + target.size
        data = {}
        for head, count in ((b"\0\1", COUNT_LE), (b"\0\0", COUNT_BE)):
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
        return self._store.encode(message, self.name, little_endian=_count_of(payload) is COUNT_LE)

    def _layout(self) -> Record:
        if self._root is None:
            raise PayloadError(f"{self.name} is opaque: {self._opaque}")
        return self._root

    def _plan(self, path: str) -> Plan:
        plan = make_plan(self._way(path))
        if len(self._plans) >= _CACHED_PLANS:
            self._plans.clear()
        self._plans[path] = plan
        return plan

    def _way(self, path: str) -> Way:
        try:
            return find_way(self._layout(), parse_path(path), path)
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {path}"
            raise

    def _truncated(self, payload: bytes) -> PayloadError:
        return PayloadError(f"{len(payload)} bytes are too few for {self.name}")


def _count_of(payload: Data) -> Unpack:
    """Return the reader of counts, which also tells the byte order."""
    head = payload[:2]
    if head == b"\0\1":
        return COUNT_LE
    if head == b"\0\0":
        return COUNT_BE
    raise PayloadError(f"opaque: encapsulation {head.hex() or 'missing'} is not plain CDR (0000 or 0001)")


def _encoded(value: Scalar) -> bytes:
    if not isinstance(value, str):
        raise PayloadError(f"{value!r} is no string")
    try:
        return value.encode(errors="surrogateescape")
    except UnicodeEncodeError as error:
        raise PayloadError(f"{value!r} cannot be encoded: {error}") from error


def _python_name(step: str | int) -> str | int:
    return f"{step}_" if isinstance(step, str) and keyword.iskeyword(step) else step


def _collect(node: Node, path: str, data: Data, position: int, count: Unpack, elements: int, found: list[Leaf]) -> int:
    """List a field's scalars and return where it ends."""
    if isinstance(node, Record):
        if node.jump is not None and node.jump.first == NOTHING:
            return position
        if position > len(data):  # nested empty messages may be more than anybody can walk over
            raise IndexError
        for name, each in node.fields.items():
            if name == PLACEHOLDER:
                position = skip(each, data, position, count)
            else:
                position = _collect(each, member_path(path, name), data, position, count, elements, found)
        return position
    if isinstance(node, Array):
        length, position = length_of(node, data, position, count)
        if node.length is None:
            found.append(Leaf(f"len({path})", "uint32", length))
        listed = min(length, max(elements, 0))
        for index in range(listed):
            position = _collect(node.element, f"{path}[{index}]", data, position, count, elements, found)
        return skip_elements(node.element, length - listed, data, position, count)
    position += node.padding[position & 7]
    found.append(Leaf(path, node.type, node.read(data, position, count)))
    return skip(node, data, position, count)
