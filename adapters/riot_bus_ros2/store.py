"""Definitions of ROS 2 types, on top of rosbags.

All dealings with rosbags are here, with the work-arounds that version 0.11 needs: `char` in type hashes, trailing
bytes, `wstring`. Importing rosbags and loading a distribution's types is slow, so both wait for the first question.
"""

from __future__ import annotations

import os
import re
import struct
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.errors import MissingExtraError, PayloadError
from riot_bus.types.model import Schema

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosbags.interfaces.typing import Constdefs, Fielddefs
    from rosbags.typesys.store import Typestore

    Definition = tuple[Constdefs, Fielddefs]

__all__ = [
    "DefinitionError",
    "Field",
    "TypeStore",
    "normal_name",
    "parse_idl",
    "parse_msg",
    "references",
    "require_rosbags",
]

_ARRAY = 3  # of rosbags' Nodetype: 1 base type, 2 message, 3 array, 4 sequence
_DISTROS = ("ros2_kilted", "ros2_lyrical")
_SEPARATOR = re.compile(r"^=+\n(?:MSG|IDL): *(\S+)[ \t]*\n", re.MULTILINE)
_WSTRING = re.compile(r"^([ \t]*wstring)<=\d+", re.MULTILINE)

_stores: dict[str, Typestore] = {}


class DefinitionError(Exception):
    """A definition's text does not parse."""


def require_rosbags() -> None:
    """Raise MissingExtraError unless rosbags is installed; does not import it."""
    if find_spec("rosbags") is None:
        raise MissingExtraError("rosbags", "ros2")


def normal_name(name: str) -> str:
    """Return `pkg/msg/Name` for `pkg/Name` too."""
    package, slash, rest = name.partition("/")
    return name if not slash or "/" in rest else f"{package}/msg/{rest}"


def parse_msg(text: str, name: str) -> dict[str, Definition]:
    """Parse the text of a .msg file or of a log's `ros2msg` schema, which brings its dependencies along."""
    require_rosbags()
    from rosbags.typesys import TypesysError, get_types_from_msg

    text = _WSTRING.sub(r"\1", text.replace("\r\n", "\n"))
    try:
        return dict(get_types_from_msg(text, normal_name(name)))
    except (TypesysError, RecursionError, ValueError) as error:
        raise DefinitionError(str(error)) from error


def parse_idl(text: str) -> dict[str, Definition]:
    """Parse a log's `ros2idl` schema: IDL sections, each after a line of `=` and its name."""
    require_rosbags()
    from rosbags.typesys import TypesysError, get_types_from_idl

    found: dict[str, Definition] = {}
    try:
        for section in _SEPARATOR.split(text.replace("\r\n", "\n"))[::2]:
            if section.strip():
                found |= get_types_from_idl(section)
    except (TypesysError, RecursionError, ValueError) as error:
        raise DefinitionError(str(error)) from error
    return found


def references(definition: Definition) -> Iterator[str]:
    """Yield the names of the message types that a definition's fields have."""
    return (field.content for field in _fields(definition) if field.is_message)


class Field(NamedTuple):
    """One field: its base or message type, and for arrays their length (None: a sequence)."""

    name: str
    content: str
    is_message: bool
    is_array: bool = False
    length: int | None = None


def _fields(definition: Definition) -> Iterator[Field]:
    for name, (kind, content) in definition[1]:
        inner: Any = content
        if kind >= _ARRAY:
            inner = content[0][1]
        is_message = isinstance(inner, str) and not inner.endswith("/wstring")
        base = inner if is_message else "wstring" if isinstance(inner, str) else str(inner[0])
        yield Field(name, base, is_message, kind >= _ARRAY, int(content[1]) if kind == _ARRAY else None)


class TypeStore:
    """Definitions by name: own ones first, then the distribution's, then those of `AMENT_PREFIX_PATH`.

    Args:
        own: Definitions that override all others, such as those of a log.
    """

    def __init__(self, own: Mapping[str, Definition] | None = None) -> None:
        self._own: dict[str, Definition] = dict(own or {})
        self._typestores: dict[str, Typestore] = {}

    def register(self, definitions: Mapping[str, Definition]) -> None:
        """Add definitions that override what was there."""
        self._own.update(definitions)
        self._typestores.clear()

    def definition(self, name: str) -> Definition | None:
        """Return constants and fields of a type, None if it is unknown."""
        found = self._own.get(name)
        if found is not None:
            return found
        for distro in _DISTROS:
            found = _distribution(distro).fielddefs.get(name)
            if found is not None:
                return found
        found = _from_ament(name)
        if found is not None:
            self._own[name] = found
        return found

    def fields(self, name: str) -> list[Field]:
        """Return the fields of a type in order; raises KeyError if it is unknown."""
        definition = self.definition(name)
        if definition is None:
            raise KeyError(name)
        return list(_fields(definition))

    def names(self) -> list[str]:
        """Return the names of all types that need no search in files."""
        return sorted({*self._own, *_distribution(_DISTROS[0]).fielddefs})

    def closure(self, name: str) -> dict[str, Definition]:
        """Return the definitions of a type and of all types in it; raises KeyError with an unknown one's name."""
        found: dict[str, Definition] = {}
        pending = [name]
        while pending:
            each = pending.pop()
            if each not in found:
                definition = self.definition(each)
                if definition is None:
                    raise KeyError(each)
                found[each] = definition
                pending += references(definition)
        return found

    def type_hash(self, name: str) -> str:
        """Return the RIHS01 hash that stands in rmw_zenoh's keys (REP 2016); raises KeyError if unknown."""
        return self._typestore(name).hash_rihs01(name)

    def schema(self, name: str) -> Schema:
        """Return the `ros2msg` text with all dependencies; empty for types that rosbags cannot write down."""
        try:
            text = self._typestore(name).generate_msgdef(name, ros_version=2)[0]
        except _rosbags_errors():
            text = ""
        return Schema(name, "ros2msg", text.encode())

    def decode(self, payload: bytes, name: str) -> Any:
        """Return a payload as rosbags' message object; bytes after its end are let pass."""
        definition = self._typestore(name).get_msgdef(name)
        deserialize = definition.deserialize_cdr_le if payload[1:2] == b"\1" else definition.deserialize_cdr_be
        try:
            return deserialize(memoryview(payload)[4:], 0, definition.cls, self._typestore(name))[0]
        except _rosbags_errors() as error:
            raise PayloadError(f"does not decode as {name}: {error}") from error

    def encode(self, message: Any, name: str, *, little_endian: bool = True) -> bytes:
        """Return the payload of rosbags' message object."""
        try:
            return bytes(self._typestore(name).serialize_cdr(message, name, little_endian=little_endian))
        except _rosbags_errors() as error:
            raise PayloadError(f"does not encode as {name}: {error}") from error

    def _typestore(self, name: str) -> Typestore:
        store = self._typestores.get(name)
        if store is None:
            store = self._typestores[name] = self._make_typestore(name)
        return store

    def _make_typestore(self, name: str) -> Typestore:
        needed = self.closure(name)
        for distro in _DISTROS:
            store = _distribution(distro)
            if all(store.fielddefs.get(each) is definition for each, definition in needed.items()):
                return store
        from rosbags.typesys.store import Typestore

        store = Typestore()
        store.register(needed)
        return store


def _rosbags_errors() -> tuple[type[Exception], ...]:
    """Return what rosbags raises on hostile bytes, odd values and types that it cannot write down."""
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    builtin = (ValueError, LookupError, ArithmeticError, TypeError, AttributeError, AssertionError, struct.error)
    return (SerdeError, TypesysError, *builtin)


def _distribution(name: str) -> Typestore:
    store = _stores.get(name)
    if store is None:
        require_rosbags()
        from rosbags.typesys import Stores, get_typestore
        from rosbags.typesys import store as rosbags_store

        rosbags_store.TIDMAP["char"] = rosbags_store.TIDMAP["uint8"]  # rosidl maps `char` of .msg files to uint8
        store = _stores[name] = get_typestore(Stores(name))
    return store


def _from_ament(name: str) -> Definition | None:
    package, _, rest = name.partition("/")
    kind, _, short = rest.partition("/")
    if kind != "msg" or not package.isidentifier() or not short.isidentifier():
        return None
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        file = Path(prefix, "share", package, "msg", f"{short}.msg")
        try:
            return parse_msg(file.read_text(), name)[name]
        except (OSError, UnicodeDecodeError, DefinitionError):
            continue
    return None
