"""CDR payloads of ROS 2: finds the offsets of scalars, and reads and patches them in place."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from riot_bus.types.model import REBUILD, Leaf, Schema, check_leaves, encoded_text, member_path, parse_path, why_opaque
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.cdr_fields import list_fields, list_parts
from riot_bus_ros2.cdr_layout import (
    COUNT_BE,
    COUNT_LE,
    ORIGIN,
    OUTSIDE,
    Array,
    Data,
    Node,
    Number,
    Opaque,
    Struct,
    Text,
    Unpack,
    compile_type,
    length_of,
    skip_elements,
)
from riot_bus_ros2.cdr_plan import FieldPlan, Way, find_way, make_plan
from riot_bus_ros2.common_fields import allows_non_finite
from riot_bus_ros2.hashes import PLACEHOLDER

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from riot_bus.types.capabilities import MessagePart
    from riot_bus.types.fields import FieldType
    from riot_bus.types.payloads import Gathered, Payloads
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_ros2.store import TypeStore

_CACHED_PLANS = 4096
_ENCAPSULATIONS = {
    2: "PL_CDR", 3: "PL_CDR", 4: "XML", 6: "XCDR2", 7: "XCDR2", 8: "delimited XCDR2", 9: "delimited XCDR2",
    10: "PL_CDR2", 11: "PL_CDR2",
}  # fmt: skip
"""Representations of DDS-XTypes 1.3 (7.6.3.1.2) that ROS 2 does not use for its messages."""


class CdrType:
    """One ROS 2 message type in CDR, little- or big-endian.

    Args:
        schema: The definition from a log; by default written from `store`.
        opaque: Reason why the definition cannot be trusted; empty if it can.
    """

    encoding = "cdr"

    def __init__(self, name: str, store: TypeStore, *, schema: Schema | None = None, opaque: str = "") -> None:
        self.name = name
        self._store = store
        self._schema = schema
        self._plans: dict[str, FieldPlan] = {}
        self._root = Opaque(opaque) if opaque else compile_type(name, store, outer=(), done={})

    @property
    def schema(self) -> Schema:
        """Definition for the log with all dependencies; empty text if the type cannot be written as `ros2msg`."""
        if self._schema is None:
            self._schema = self._store.schema(self.name)
        return self._schema

    @property
    def type_hash(self) -> str:
        """The RIHS01 hash that is part of rmw_zenoh's keys."""
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

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be taken apart, None if it can."""
        return why_opaque(self, payload)

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array or sequence)."""
        plan = self._plans.get(path) or self._plan(path)
        count = _count_of(payload)
        target = plan.target
        try:
            position = plan.locate(payload, count)
            if isinstance(target, Array):
                if target.skip(payload, position, count) > len(payload):
                    raise self._truncated(payload)
                return length_of(target, payload, position, count)[0]
            assert isinstance(target, Number | Text)
            return target.read(payload, position, count)
        except OUTSIDE as error:
            raise self._truncated(payload) from error
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {path}"
            raise

    def gather(self, payloads: Payloads, path: str) -> Gathered:
        """Return one field of many payloads at once, as `riot_bus.types.capabilities.GathersFields` says."""
        from riot_bus_ros2.cdr_bulk import gather

        plan = self._plans.get(path) or self._plan(path)
        return gather(plan.way, payloads)

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array of numbers, as `riot_bus.types.capabilities.DescribesFields` says."""
        from riot_bus_ros2.cdr_bulk import elements

        return elements(self._way(f"len({path})"), payloads)

    def fields(self) -> Sequence[FieldType]:
        """List the fields that messages of this type have, in payload order."""
        return list_fields(self._layout(), self._constants)

    def _constants(self, name: str) -> Sequence[tuple[str, str, object]]:
        definition = self._store.definition(name)
        return () if definition is None else definition[0]

    def parts(self) -> Sequence[MessagePart]:
        """List the messages that one of this type is made of, as `riot_bus.types.capabilities.ListsParts` says."""
        self._layout()
        try:
            return list_parts(self.name, self._store.fields)
        except KeyError as error:
            raise PayloadError(f"opaque: type {error.args[0]} is unknown", where=self.name) from error

    def allows_non_finite(self, path: str) -> bool:
        """Return whether NaN or an infinity is not a fault, as `riot_bus.types.capabilities.AllowsNonFinite` says."""
        return allows_non_finite(self.name, path)

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced in place; its length stays the same."""
        count = _count_of(payload)
        splices: list[tuple[int, bytes]] = []
        for path, value in changes.items():
            plan = self._plans.get(path) or self._plan(path)
            target = plan.target
            try:
                position = plan.locate(payload, count)
                if isinstance(target, Number):
                    packed = target.pack(count, value)
                    if position + target.size > len(payload):
                        raise self._truncated(payload)
                elif isinstance(target, Text):
                    position, end = target.span(payload, position, count)
                    if not isinstance(value, str):
                        raise PayloadError(f"{value!r} is not a string")
                    packed = encoded_text(value)
                    if len(packed) != end - position:
                        raise PayloadError(f"text of {len(packed)} bytes instead of {end - position}", hint=REBUILD)
                else:
                    raise PayloadError("a length cannot be patched in place", hint=REBUILD)
            except OUTSIDE as error:
                raise self._truncated(payload) from error
            except PayloadError as error:
                error.where = error.where or f"{self.name}: {path}"
                raise
            splices.append((position, packed))
        return _spliced(payload, splices)

    def rebuild(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with changes that may move what follows: text of any size, and lengths of sequences."""
        try:
            return self.patch(payload, changes)
        except PayloadError as error:
            if error.hint != REBUILD and not any(path.startswith("len(") for path in changes):
                raise
        from riot_bus_ros2.cdr_rebuild import rebuild

        for path in changes:
            self._way(path)
        try:
            return rebuild(self._layout(), _count_of(payload), self.patch, payload, changes)
        except OUTSIDE as error:
            raise self._truncated(payload) from error
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {', '.join(changes)}"
            raise

    def patcher(self, path: str, value: Scalar) -> Callable[[bytes], bytes] | None:
        """Return a function that sets a field to a fixed value, None unless its place is the same in all payloads."""
        plan = self._plans.get(path) or self._plan(path)
        target = plan.target
        if plan.steps or not isinstance(target, Number):
            return None
        start, end = plan.start, plan.start + target.size
        data = {head: target.pack(count, value) for head, count in ((b"\0\1", COUNT_LE), (b"\0\0", COUNT_BE))}

        def patch(payload: bytes) -> bytes:
            packed = data.get(payload[:2])
            if packed is None or len(payload) < end:
                return self.patch(payload, {path: value})  # raises an error that says what is wrong
            return b"%b%b%b" % (payload[:start], packed, payload[end:])

        return patch

    def _layout(self) -> Struct:
        if isinstance(self._root, Opaque):
            error = self._root.error()
            error.where = self.name
            raise error
        return self._root

    def _plan(self, path: str) -> FieldPlan:
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
    name = _ENCAPSULATIONS.get(int.from_bytes(head)) if len(head) == 2 else None
    what = f"{head.hex()} ({name})" if name else head.hex() or "missing"
    raise PayloadError(f"opaque: encapsulation {what} is not plain CDR (0000 or 0001)")


def _spliced(payload: bytes, splices: list[tuple[int, bytes]]) -> bytes:
    """Return the payload with bytes overwritten at some offsets; for a single offset, it is copied only once."""
    if len(splices) == 1:
        position, packed = splices[0]
        view = memoryview(payload)
        return b"".join((view[:position], packed, view[position + len(packed) :]))
    data = bytearray(payload)
    for position, packed in splices:
        data[position : position + len(packed)] = packed
    return bytes(data)


def _collect(node: Node, path: str, data: Data, position: int, count: Unpack, elements: int, found: list[Leaf]) -> int:
    """List a field's scalars and return where it ends."""
    if isinstance(node, Number):  # first, since most are
        position += node.padding[position & 7]
        found.append(Leaf(path, node.type, node.read(data, position, count)))
        return position + node.size
    if isinstance(node, Struct):
        if not node.listed:
            return node.skip(data, position, count)
        if position > len(data):
            raise IndexError
        check_leaves(len(found), elements)  # types that nest have 2 to the power of any number of fields
        for name, each in node.fields.items():
            if name == PLACEHOLDER:
                position = each.skip(data, position, count)
            else:
                position = _collect(each, member_path(path, name), data, position, count, elements, found)
        return position
    if isinstance(node, Array):
        length, position = length_of(node, data, position, count)
        if node.length is None:
            found.append(Leaf(f"len({path})", "uint32", length))
        listed = min(length, max(elements, 0)) if node.element.listed else 0
        for index in range(listed):
            position = _collect(node.element, f"{path}[{index}]", data, position, count, elements, found)
        return skip_elements(node.element, length - listed, data, position, count)
    if isinstance(node, Opaque):
        raise node.error()
    position += node.padding[position & 7]
    found.append(Leaf(path, node.type, node.read(data, position, count)))
    return node.skip(data, position, count)
