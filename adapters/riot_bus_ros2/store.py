"""Definitions of ROS 2 types by name, from several sources in order, and messages as objects through rosbags.

Importing rosbags and loading a distribution's types is slow, so both are delayed until first use.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.definitions import Field, fields_of, references
from riot_bus_ros2.hashes import type_hash
from riot_bus_ros2.schema_text import schema_text
from riot_bus_ros2.sources import DISTROS, OLDER, from_ament, from_common_services, from_distribution, rosbags_store

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rosbags.typesys.store import Typestore

    from riot_bus_ros2.definitions import Definition
    from riot_bus_ros2.sources import Source

_LONGEST = 1 << 12  # a guess: rosbags generates and compiles a line of code for each element
_OF_USER = 2  # number of sources before the distributions
_MOST_TOLD = 1 << 12  # a guess: nodes may describe any number of types, and each takes a store


class TypeStore:
    """Definitions by name.

    They come from, in this order: a log, `AMENT_PREFIX_PATH`, files that the user named, distributions as rosbags has
    them, and services and actions of every ROS installation. Definitions from nodes are kept separately (`learn`).

    Args:
        sources: Sources that replace the default ones, after `recorded`.
    """

    def __init__(self, recorded: Mapping[str, Definition] | None = None, *, sources: Sequence[Source] = ()) -> None:
        self._recorded: dict[str, Definition] = dict(recorded or {})
        self._files: dict[str, Definition] = {}
        self._told: dict[tuple[str, str], TypeStore] = {}
        distributions: tuple[Source, ...] = tuple(map(from_distribution, DISTROS))
        usual: tuple[Source, ...] = (from_ament, self._files.get, *distributions, from_common_services)
        self._sources = tuple(sources) or usual
        self._found: dict[str, Definition] = {}
        self._typestores: dict[str, Typestore] = {}

    def register(self, definitions: Mapping[str, Definition]) -> None:
        """Add definitions from files."""
        self._files.update(definitions)
        self._found.clear()
        self._typestores.clear()

    def learn(self, name: str, definitions: Mapping[str, Definition]) -> None:
        """Add a node's description of a type: its definition, and those of all types in it.

        They are used for this type only, if no other source has a definition with the same hash (`matching`) or with
        the same name (`told`).
        """
        if len(self._told) < _MOST_TOLD:
            self._told[name, type_hash(name, definitions)] = TypeStore(definitions)

    def told(self, name: str) -> TypeStore | None:
        """Return a store with the last description of a type from a node, None if there is none."""
        return next((store for (each, _), store in reversed(list(self._told.items())) if each == name), None)

    def definition(self, name: str) -> Definition | None:
        """Return constants and fields of a type, None if it is unknown."""
        found = self._recorded.get(name) or self._found.get(name)
        if found is not None:
            return found
        for source in self._sources:
            found = source(name)
            if found is not None:
                self._found[name] = found
                return found
        return None

    def fields(self, name: str) -> list[Field]:
        """Return the fields of a type in order; raises KeyError if it is unknown."""
        definition = self.definition(name)
        if definition is None:
            raise KeyError(name)
        return list(fields_of(definition))

    def names(self) -> list[str]:
        """Return the names of all types that need no search in files."""
        return sorted(
            {*self._recorded, *self._files, *(name for name, _ in self._told), *rosbags_store(DISTROS[0]).fielddefs}
        )

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
                pending += reversed(list(references(definition)))
        return found

    def type_hash(self, name: str) -> str:
        """Return the RIHS01 hash (REP 2016) that is part of rmw_zenoh's keys; raises KeyError if unknown."""
        return type_hash(name, self.closure(name))

    def matching(self, name: str, wanted: str) -> TypeStore | None:
        """Return a store in which the type has this hash: this one or one that prefers a source; None without one."""
        told = self._told.get((name, wanted))
        if told is not None:
            return told
        older = tuple(map(from_distribution, OLDER))
        for first in (None, *self._sources, *older):
            store = self if first is None else self.preferring(first)
            try:
                if store.type_hash(name) == wanted:
                    return store
            except KeyError:
                continue
        return None

    def preferring(self, source: Source, *, to_distributions: bool = False) -> TypeStore:
        """Return a store that asks this source before all others except logs, or only before the distributions."""
        place = _OF_USER if to_distributions else 0
        return TypeStore(self._recorded, sources=(*self._sources[:place], source, *self._sources[place:]))

    def schema(self, name: str) -> Schema:
        """Return the `ros2msg` text with all dependencies; empty if some are unknown."""
        try:
            text = schema_text(name, self.closure(name))
        except KeyError:
            text = ""
        return Schema(name, "ros2msg", text.encode())

    def decode(self, payload: bytes, name: str) -> Any:
        """Return a payload as rosbags' message object; bytes after its end are ignored, and arrays are writable."""
        try:
            store = self._typestore(name)
            definition = store.get_msgdef(name)
            deserialize = definition.deserialize_cdr_le if payload[1:2] == b"\1" else definition.deserialize_cdr_be
            # rosbags' arrays are views of its input: read-only ones if that is bytes
            return deserialize(memoryview(bytearray(payload))[4:], 0, definition.cls, store)[0]
        except _rosbags_errors() as error:
            raise PayloadError(f"does not decode as {name}: {error}") from error

    def _typestore(self, name: str) -> Typestore:
        store = self._typestores.get(name)
        if store is None:
            store = self._typestores[name] = self._make_typestore(name)
        return store

    def _make_typestore(self, name: str) -> Typestore:
        needed = self.closure(name)
        for distro in DISTROS:
            store = rosbags_store(distro)
            if all(store.fielddefs.get(each) is definition for each, definition in needed.items()):
                return store
        for definition in needed.values():
            for field in fields_of(definition):  # rosbags generates a line of code for each element
                if (field.is_message or field.content == "string") and (field.length or 0) > _LONGEST:
                    raise PayloadError(f"{name} has an array of {field.length} elements, which is too long for rosbags")
        from rosbags.typesys.store import Typestore

        store = Typestore()
        store.register(needed)
        return store


def _rosbags_errors() -> tuple[type[Exception], ...]:
    """Return what rosbags raises on hostile bytes and types that it cannot handle."""
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    builtin = (ValueError, LookupError, ArithmeticError, TypeError, AttributeError, AssertionError, struct.error)
    return (SerdeError, TypesysError, RecursionError, SyntaxError, *builtin)
