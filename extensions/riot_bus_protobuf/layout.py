"""Messages as descriptor sets define them: fields by name and by number, presence, comments.

Source: google/protobuf/descriptor.proto. The descriptors are read directly, without a pool, so that incomplete sets are
usable: fields of missing types are left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

from riot_bus.vocabulary.errors import PayloadError, needs_extra
from riot_bus.vocabulary.message import Scalar
from riot_bus_protobuf.units import unit_in
from riot_bus_protobuf.wire import KINDS, ScalarKind

_MAX_SET = 1 << 24  # a guess, far more than definitions need: bounds the work that a log can cause
_TYPES = (
    "", "double", "float", "int64", "uint64", "int32", "fixed64", "fixed32", "bool", "string", "group", "message",
    "bytes", "uint32", "enum", "sfixed32", "sfixed64", "sint32", "sint64",
)  # fmt: skip
_DEFAULTS: dict[str, Scalar] = {"bool": False, "string": "", "bytes": b"", "float32": 0.0, "float64": 0.0}
_DEVIATES = 2  # IMPLICIT, EXPANDED and DELIMITED: the value of each feature that is not its default
_UNITS = {
    f"google.protobuf.{name}.{member}": unit
    for name in ("Timestamp", "Duration")
    for member, unit in (("seconds", "s"), ("nanos", "ns"))
}


@dataclass(slots=True)
class ProtobufField:
    """One field of a message.

    Attributes:
        kind: Kind of scalar; None for a message.
        message: Full name of a message's type.
        packed: Whether the first elements of an array are written packed.
        group: Whether a message is written as a group.
        presence: Whether it may be absent; otherwise, it has its default (zero or empty) if not on the wire.
        oneof: Number of its oneof, of whose fields at most one is set; -1 if it is in none.
    """

    name: str
    number: int
    kind: ScalarKind | None
    message: str
    repeated: bool
    packed: bool
    group: bool
    presence: bool
    oneof: int = -1
    low: float | None = None
    high: float | None = None
    unit: str = ""
    names: tuple[tuple[int, str], ...] = ()

    @property
    def default(self) -> Scalar:
        """Value of a field without presence that is not on the wire."""
        return _DEFAULTS.get(self.kind.leaf, 0) if self.kind is not None else 0


@dataclass(slots=True)
class Layout:
    """A message type; `entry` tells whether it represents the entries of a map."""

    name: str
    fields: dict[str, ProtobufField] = field(default_factory=dict)
    numbers: dict[int, ProtobufField] = field(default_factory=dict)
    entry: bool = False
    _oneofs: dict[int, frozenset[int]] = field(default_factory=dict)

    def rivals(self, one: ProtobufField) -> Collection[int]:
        """Return the numbers of the field itself and of the other fields in its oneof."""
        if one.oneof < 0:
            return (one.number,)
        found = self._oneofs.get(one.oneof)
        if found is None:
            numbers = (each.number for each in self.numbers.values() if each.oneof == one.oneof)
            found = self._oneofs[one.oneof] = frozenset(numbers)
        return found


@dataclass(frozen=True, slots=True)
class _Source:
    """Where a message is defined: its descriptor, its file, and its place in that file's comments."""

    descriptor: Any
    file: Any
    place: tuple[int, ...]


def load_set(data: bytes) -> Any:
    """Parse a FileDescriptorSet.

    Raises:
        MissingExtraError: The library is not installed.
        PayloadError: The bytes are not a FileDescriptorSet.
    """
    with needs_extra("protobuf", "protobuf"):
        from google.protobuf import descriptor_pb2
        from google.protobuf.message import DecodeError
    if len(data) > _MAX_SET:
        raise PayloadError(f"a descriptor set of {len(data)} bytes is over the limit of {_MAX_SET}")
    try:
        found = descriptor_pb2.FileDescriptorSet.FromString(data)
    except (DecodeError, RecursionError) as error:
        raise PayloadError(f"not a FileDescriptorSet: {error}") from error
    if not found.file:
        raise PayloadError("this FileDescriptorSet holds no file")
    return found


class Definitions:
    """The messages of a descriptor set."""

    def __init__(self, files: dict[str, Any]) -> None:
        self._files = files
        self._sources: dict[str, _Source] = {}
        self._enums: dict[str, tuple[tuple[int, str], ...]] = {}
        self._layouts: dict[str, Layout] = {}
        self._comments: dict[str, dict[tuple[int, ...], str]] = {}
        for file in files.values():
            package = f"{file.package}." if file.package else ""
            self._index_enums(file.enum_type, package)
            for index, message in enumerate(file.message_type):
                self._index(message, package, file, (4, index))

    def names(self) -> list[str]:
        """Return the full names of all messages except the entries of maps."""
        return sorted(name for name, source in self._sources.items() if not source.descriptor.options.map_entry)

    def layout(self, name: str) -> Layout | None:
        """Return a message by its full name, None if it is unknown."""
        found = self._layouts.get(name)
        source = self._sources.get(name)
        if found is None and source is not None:
            found = self._layouts[name] = self._compile(name, source)
        return found

    def inside(self, one: ProtobufField) -> Layout:
        """Return the type of a field that is a message."""
        found = self.layout(one.message)
        assert found is not None  # fields of unknown types are left out
        return found

    def entry(self, one: ProtobufField) -> Layout | None:
        """Return the type of the entries of a map; None for other fields."""
        if one.kind is not None or not one.repeated:
            return None
        layout = self.inside(one)
        return layout if layout.entry and {1, 2} <= layout.numbers.keys() else None

    def serialized(self, name: str) -> bytes:
        """Return a descriptor set of the file that defines a message and of those that it imports."""
        from google.protobuf import descriptor_pb2

        found = descriptor_pb2.FileDescriptorSet()
        found.file.extend(_ordered(self._sources[name].file.name, self._files))
        data: bytes = found.SerializeToString(deterministic=True)
        return data

    def _index(self, message: Any, prefix: str, file: Any, place: tuple[int, ...]) -> None:
        name = prefix + message.name
        self._sources[name] = _Source(message, file, place)
        self._index_enums(message.enum_type, f"{name}.")
        for index, inner in enumerate(message.nested_type):
            self._index(inner, f"{name}.", file, (*place, 3, index))

    def _index_enums(self, enums: Any, prefix: str) -> None:
        for enum in enums:
            self._enums[prefix + enum.name] = tuple((value.number, value.name) for value in enum.value)

    def _compile(self, name: str, source: _Source) -> Layout:
        message, file = source.descriptor, source.file
        if file.name not in self._comments:
            self._comments[file.name] = _comments(file)
        comments = self._comments[file.name]
        layout = Layout(name, entry=message.options.map_entry)
        for index, one in enumerate(message.field):
            made = self._field(one, file, entry=layout.entry)
            if made is not None:
                made.unit = _UNITS.get(f"{name}.{made.name}") or unit_in(comments.get((*source.place, 2, index), ""))
                layout.fields[made.name] = made
                layout.numbers[made.number] = made
        return layout

    def _field(self, one: Any, file: Any, *, entry: bool) -> ProtobufField | None:
        type_name = _TYPES[one.type] if one.type < len(_TYPES) else ""
        target = one.type_name.removeprefix(".")
        kind = KINDS.get(type_name)
        if kind is None and target not in self._sources:
            return None
        repeated = one.label == 3  # LABEL_REPEATED of descriptor.proto
        names = self._enums.get(target, ()) if type_name == "enum" else ()
        return ProtobufField(
            one.name,
            one.number,
            kind,
            "" if kind is not None else target,
            repeated,
            packed=repeated and kind is not None and kind.wire != KINDS["bytes"].wire and _packed(one, file),
            group=type_name == "group"
            or (str(file.syntax) == "editions" and _feature("message_encoding", one, file) == _DEVIATES),
            presence=not repeated and not entry and (kind is None or _presence(one, file)),
            oneof=one.oneof_index if one.HasField("oneof_index") else -1,
            low=min(names)[0] if names else None,
            high=max(names)[0] if names else None,
            names=names,
        )


def _presence(one: Any, file: Any) -> bool:
    if one.HasField("oneof_index"):
        return True
    if file.syntax == "editions":
        return _feature("field_presence", one, file) != _DEVIATES
    return str(file.syntax) != "proto3"


def _packed(one: Any, file: Any) -> bool:
    if file.syntax == "editions":
        return _feature("repeated_field_encoding", one, file) != _DEVIATES
    if one.options.HasField("packed"):
        return bool(one.options.packed)
    return bool(file.syntax == "proto3")


def _feature(name: str, one: Any, file: Any) -> int:
    """Return a feature of editions, 0 if neither the field nor its file sets it."""
    for options in (one.options, file.options):
        features = getattr(options, "features", None)
        if features is not None and features.HasField(name):
            return int(getattr(features, name))
    return 0


def _comments(file: Any) -> dict[tuple[int, ...], str]:
    """Return the comments of a file, by the paths of the definitions that they describe."""
    return {
        tuple(location.path): f"{location.trailing_comments} {location.leading_comments}"
        for location in file.source_code_info.location
        if location.trailing_comments or location.leading_comments
    }


def _ordered(name: str, files: dict[str, Any]) -> Iterator[Any]:
    """Yield a file after those that it imports."""
    done: set[str] = set()
    stack = [(name, False)]
    while stack:
        each, ready = stack.pop()
        if each not in files or (each in done and not ready):
            continue
        if ready:
            yield files[each]
            continue
        done.add(each)
        stack.append((each, True))
        stack += [(other, False) for other in reversed(files[each].dependency)]
