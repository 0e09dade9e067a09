"""The source of Protocol Buffers types: descriptor sets in files that the user names, and in logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from riot_bus.given_files import given_bytes
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError, PayloadError, require_package
from riot_bus_protobuf.kind import ProtobufType
from riot_bus_protobuf.layout import Definitions, load_set

_HINT = "write it with `protoc --include_imports --include_source_info --descriptor_set_out=FILE`"


class ProtobufTypes:
    """Implements `riot_bus.types.model.TypeSource` for Protocol Buffers.

    Raises:
        MissingExtraError: The library is not installed.
    """

    name = "protobuf"

    def __init__(self) -> None:
        require_package("google.protobuf", "protobuf", package="protobuf")
        self._files: dict[str, Any] = {}
        self._definitions = Definitions({})
        self._types: dict[str, ProtobufType] = {}
        self._from_schemas: dict[Schema, ProtobufType | None] = {}

    def load(self, files: Sequence[Path]) -> None:
        """Load files that contain a FileDescriptorSet, as protoc writes them.

        Raises:
            ConfigError: A file cannot be read, or is not a FileDescriptorSet.
        """
        for file in files:
            try:
                found = load_set(given_bytes(file))
            except OSError as error:
                raise ConfigError(f"cannot read the definition: {error.strerror}", where=str(file)) from error
            except PayloadError as error:
                raise ConfigError(error.message, where=str(file), hint=_HINT) from error
            self._files.update({each.name: each for each in found.file})
        self._definitions = Definitions(self._files)
        self._types.clear()

    def type_named(self, type_name: str) -> ProtobufType | None:
        """Return the message type of this full name, such as `foxglove.LaserScan`."""
        name = type_name.removeprefix(".")
        if name not in self._types and self._definitions.layout(name) is not None:
            self._types[name] = ProtobufType(name, self._definitions)
        return self._types.get(name)

    def type_names(self) -> list[str]:
        """Return the full names of all message types that were loaded."""
        return self._definitions.names()

    def type_of_schema(self, schema: Schema) -> ProtobufType | None:
        """Return the type from the descriptor set of a log, which has priority over loaded files."""
        if schema.encoding != "protobuf":
            return None
        if schema not in self._from_schemas:
            self._from_schemas[schema] = _parsed(schema)
        return self._from_schemas[schema]


def _parsed(schema: Schema) -> ProtobufType | None:
    try:
        found = load_set(schema.data)
    except PayloadError:
        return None
    definitions = Definitions({each.name: each for each in found.file})
    name = schema.name.removeprefix(".")
    return ProtobufType(name, definitions, schema=schema) if definitions.layout(name) is not None else None
