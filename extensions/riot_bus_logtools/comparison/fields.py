"""The fields of messages, and a comparison of two messages: which fields differ, and whether that is tolerated."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, Final

import msgpack  # type: ignore[import-untyped]

from riot_bus.types.brittle import why_brittle
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_logtools.comparison.recording import HASH_BYTES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message, Scalar
    from riot_bus_logtools.comparison.tolerances import Tolerance, TolerancesOfTopic

MOST_ELEMENTS = 4096
"""Most elements of an array that are fields of their own; the others are compared as bytes."""

PAYLOAD, KIND, ATTACHMENT = "(payload)", "(kind)", "(attachment)"
"""What is compared besides fields: payloads that do not decode, whether a message is a delete, and attachments."""

_INDEX = re.compile(r"\[\d+\]")
_SEQUENCE = "sequence number"
_MOST_PATHS = 1 << 18  # of all known shapes: those of 64 arrays that are MOST_ELEMENTS long


class _Odd:
    """A truth value, which Python considers equal to a number, or NaN, which is not equal to itself."""

    def __init__(self, value: Scalar) -> None:
        self.value = value


_NAN: Final = _Odd(float("nan"))
_TRUTH: Final = {True: _Odd(value=True), False: _Odd(value=False)}

_PACK: Final = msgpack.Packer(default=lambda odd: odd.value, unicode_errors="surrogatepass").pack

Value = Any
"""A scalar or an `_Odd`; values are the same if they are equal."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The fields of those messages of a topic that have the same ones, by their indices.

    Attributes:
        identity: Indices of the fields that tell the messages of a publisher apart: stamps, or else sequence numbers.
        cut: Arrays that have more elements than are listed.
    """

    number: int
    paths: tuple[str, ...]
    rules: tuple[Tolerance, ...]
    names: tuple[str, ...]
    place: Mapping[str, int]
    compared: tuple[int, ...]
    identity: tuple[int, ...]
    cut: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The fields of one message; `opaque` says why its payload counts as a single field, if it does."""

    message: Message
    kind: MessageType | None
    shape: Shape
    values: tuple[Value, ...]
    opaque: str = ""

    def content(self) -> bytes:
        """Return a hash of the fields that are compared; messages of equal content are the same."""
        values = self.values
        known = [self.shape.number, *[values[place] for place in self.shape.compared]]
        return blake2b(_PACK(known), digest_size=HASH_BYTES).digest()

    def identity(self) -> tuple[Value, ...] | None:
        """Return the stamps or sequence numbers, None if there are none."""
        return tuple([self.values[place] for place in self.shape.identity]) or None


@dataclass(frozen=True, slots=True)
class FieldChange:
    """A field that is not the same in two messages; None stands for the value of a message that has no such field.

    In the name, unlike in the path, `[*]` stands for any element; `allowed` tells whether the change is tolerated.
    """

    path: str
    name: str
    before: Scalar | None
    after: Scalar | None
    rule: Tolerance
    allowed: bool


class Shapes:
    """Reads the messages of one topic in both logs."""

    def __init__(self, tolerances: TolerancesOfTopic, *, attachments: bool = True) -> None:
        self._tolerances, self._attachments = tolerances, attachments
        self._known: dict[tuple[str, tuple[str, ...]], Shape] = {}
        self._paths = self._count = 0

    def read(self, message: Message, registry: TypeRegistry) -> Reading:
        """Return the fields of a message; if it does not decode, its whole payload is one field."""
        payload = message.payload
        kind = registry.type_of_message(message) if payload else None
        why = "" if kind or not payload else "no type is known"
        paths: list[str] = []
        values: list[Value] = []
        try:
            leaves = kind.leaves(payload, elements=MOST_ELEMENTS) if kind else ()
            paths = [leaf.path for leaf in leaves]
            values = [_canonical(leaf.value) for leaf in leaves]
        except PayloadError as error:
            kind, why = None, error.message
        if why or not payload:  # an empty payload is not a message without fields
            paths, values = [PAYLOAD], [payload]
        if message.kind == "delete":
            paths.append(KIND)
            values.append(message.kind)
        if self._attachments and message.attachment is not None:
            paths.append(ATTACHMENT)
            values.append(message.attachment)
        return Reading(message, kind, self._shape(kind, tuple(paths)), tuple(values), why)

    def _shape(self, kind: MessageType | None, paths: tuple[str, ...]) -> Shape:
        known = (kind.name if kind else "", paths)
        found = self._known.get(known)
        if found is None:
            self._paths += len(paths)
            if self._paths > _MOST_PATHS:  # hostile messages may each have other fields
                self._known.clear()
                self._paths = len(paths)
            found = self._known[known] = self._new(kind, paths)
        return found

    def _new(self, kind: MessageType | None, paths: tuple[str, ...]) -> Shape:
        rules = tuple(self._tolerances.of_field(path, kind) for path in paths)
        times = tuple(place for place, rule in enumerate(rules) if rule.leave == "a time")
        numbers = tuple(place for place, path in enumerate(paths) if why_brittle(path, kind) == _SEQUENCE)
        last = f"[{MOST_ELEMENTS - 1}]"
        self._count += 1
        return Shape(
            self._count,
            paths,
            rules,
            tuple(map(_name, paths)),
            {path: place for place, path in enumerate(paths)},
            tuple(place for place, rule in enumerate(rules) if not rule.leave),
            times or numbers,
            tuple(dict.fromkeys(path[: path.index(last)] for path in paths if last in path)),
        )


def differing(a: Reading, b: Reading, tolerances: TolerancesOfTopic) -> list[FieldChange]:
    """Return the fields that are not the same, whether that is tolerated or not."""
    one, other = a.shape, b.shape
    if one is other:
        pairs = zip(a.values, b.values, strict=True)
        found = [_change(one, place, left, right) for place, (left, right) in enumerate(pairs) if left != right]
    else:
        found = [*_of_two_shapes(a, b)]
    if (one.cut or other.cut) and a.message.payload != b.message.payload:
        found += _beyond(a, b, found, tolerances)
    return found


def _change(shape: Shape, place: int, left: Value, right: Value) -> FieldChange:
    rule = shape.rules[place]
    allowed = bool(rule.leave) or (_is_number(left) and _is_number(right) and rule.allows(left, right))
    return FieldChange(shape.paths[place], shape.names[place], _plain(left), _plain(right), rule, allowed)


def _of_two_shapes(a: Reading, b: Reading) -> Iterator[FieldChange]:
    one, other = a.shape, b.shape
    for place, path in enumerate(one.paths):
        there = other.place.get(path)
        if there is None:
            rule = one.rules[place]
            allowed = bool(rule.leave) or _length_allowed(path, a, b)
            yield FieldChange(path, one.names[place], _plain(a.values[place]), None, rule, allowed)
        elif a.values[place] != b.values[there]:
            yield _change(one, place, a.values[place], b.values[there])
    for place, path in enumerate(other.paths):
        if path not in one.place:
            rule = other.rules[place]
            allowed = bool(rule.leave) or _length_allowed(path, a, b)
            yield FieldChange(path, other.names[place], None, _plain(b.values[place]), rule, allowed)


def _length_allowed(path: str, a: Reading, b: Reading) -> bool:
    """Return whether an element is in one message only because array lengths differ by a tolerated amount."""
    for match in _INDEX.finditer(path):
        length = f"len({path[: match.start()]})"
        if length in a.shape.place and length in b.shape.place:
            left, right = (each.values[each.shape.place[length]] for each in (a, b))
            if left != right:
                return _change(a.shape, a.shape.place[length], left, right).allowed
    return False


def _beyond(a: Reading, b: Reading, found: list[FieldChange], tolerances: TolerancesOfTopic) -> Iterator[FieldChange]:
    """Yield a change for each array with unlisted elements, unless the changes found explain all differences."""
    if a.kind is not None and b.kind is not None and a.kind.name == b.kind.name:
        changes = {each.path: each.before for each in found if each.before is not None and each.after is not None}
        try:
            if a.kind.patch(b.message.payload, changes) == a.message.payload:
                return
        except PayloadError:
            pass  # lengths or texts differ, and with them the positions of all later bytes
    for array in dict.fromkeys(a.shape.cut + b.shape.cut):
        path = f"{array}[{MOST_ELEMENTS}]"
        rule = tolerances.of_field(path)
        yield FieldChange(path, f"{array}[*]", "(some bytes)", "(other bytes)", rule, bool(rule.leave))


def _canonical(value: Scalar) -> Value:
    if value.__class__ is bool:
        return _TRUTH[value]
    return value if value == value else _NAN


def _plain(value: Value) -> Scalar:
    found: Scalar = value.value if isinstance(value, _Odd) else value
    return found


def _is_number(value: Value) -> bool:
    return value.__class__ is float or value.__class__ is int


@lru_cache(1 << 14)
def _name(path: str) -> str:
    return _INDEX.sub("[*]", path)
