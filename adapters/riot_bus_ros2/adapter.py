"""ROS 2 over rmw_zenoh: topic names for keys, and CDR types by name, by .msg file and by a log's schema."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError, did_you_mean
from riot_bus.types.model import MessageType, Schema, TopicName
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.keys import key_expression, parse_data_key
from riot_bus_ros2.offering import clock_of, offer_of
from riot_bus_ros2.stamping import TOKENS, definition_of, details_of, stamp_of
from riot_bus_ros2.store import (
    DefinitionError,
    TypeStore,
    normal_name,
    parse_idl,
    parse_msg,
    references,
    require_rosbags,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.types.offer import Offer, RecordedTopic, SimClock
    from riot_bus.types.stamp import Stamp

__all__ = ["Ros2Adapter"]


class Ros2Adapter:
    """Implements `Adapter`, `Offering` and `Stamping` (of `riot_bus.types.model`, `offer` and `stamp`) for ROS 2.

    Raises:
        MissingExtraError: rosbags is not installed.
    """

    name = "ros2"
    tokens = TOKENS

    def __init__(self) -> None:
        require_rosbags()
        self.store = TypeStore()
        self._types: dict[str, CdrType] = {}
        self._from_schemas: dict[Schema, CdrType | None] = {}

    def topic(self, key: str) -> TopicName | None:
        """Return the ROS topic's name and type."""
        parsed = parse_data_key(key)
        return None if parsed is None else TopicName(parsed.topic, parsed.type_name)

    def key_expression(self, topic: str) -> str | None:
        """Return `*/odom/*/*` for `/odom`: any domain, type and hash."""
        return key_expression(topic)

    def load(self, files: Sequence[Path]) -> None:
        """Register .msg files in a layout `pkg/msg/Name.msg`, or directories that hold such; they override others.

        Raises:
            ConfigError: A file is missing, misplaced, does not parse, or names an unknown type.
        """
        places: dict[str, tuple[Path, str]] = {}
        for file in _message_files(files):
            name = f"{file.parent.parent.name}/msg/{file.stem}"
            text = _text(file)
            try:
                self.store.register({name: parse_msg(text, name)[name]})
            except DefinitionError as error:
                line = _first_bad_line(text, name)
                source = text.splitlines()[line - 1].strip()
                raise ConfigError(
                    f"cannot parse {source!r}", where=f"{file}:{line}", hint="write it like 'float64[3] position'"
                ) from error
            places[name] = (file, text)
        self._types.clear()
        for name, (file, text) in places.items():
            self._check_references(name, file, text)

    def type_named(self, type_name: str) -> MessageType | None:
        """Return the type `pkg/msg/Name` (or `pkg/Name`); services and actions have none."""
        name = normal_name(type_name)
        found = self._types.get(name)
        if found is None and name.count("/") == 2 and self.store.definition(name) is not None:
            found = self._types[name] = CdrType(name, self.store)
        return found

    def type_names(self) -> list[str]:
        """Return the names of all message types that need no search in files."""
        return [name for name in self.store.names() if name.split("/")[1] == "msg"]

    def type_of_schema(self, schema: Schema) -> MessageType | None:
        """Return the type by the definitions of a log, which hold for that log whatever is installed here."""
        if schema.encoding not in ("ros2msg", "ros2idl"):
            return None
        if schema not in self._from_schemas:
            self._from_schemas[schema] = self._parse_schema(schema)
        return self._from_schemas[schema]

    def offer(self, topic: RecordedTopic, *, name: str | None, domain: int | None) -> Offer | None:
        """Return how to publish a topic of a bag, or of rmw_zenoh."""
        return offer_of(topic, name=name, domain=domain, type_hash=self._type_hash)

    def clock(self, topics: Sequence[RecordedTopic], *, domain: int | None) -> SimClock:
        """Return how to publish `/clock`."""
        return clock_of(topics, domain=domain, type_hash=self.store.type_hash("rosgraph_msgs/msg/Clock"))

    def stamp(self, attachment: bytes) -> Stamp | None:
        """Return what an attachment of rmw_zenoh says."""
        return stamp_of(attachment)

    def details(self, key: str, tokens: Iterable[str]) -> Mapping[str, str]:
        """Return the offered QoS of a topic's publishers."""
        return details_of(key, tokens)

    def definition(self, key: str) -> tuple[Schema, str] | None:
        """Return the name of a topic's type, whether it is known or not."""
        return definition_of(key)

    def _type_hash(self, topic: RecordedTopic, type_name: str) -> str | None:
        found = self.type_of_schema(topic.schema) or self.type_named(type_name)
        try:
            return found.type_hash if isinstance(found, CdrType) else None
        except KeyError:  # it has members of unknown types
            return None

    def _parse_schema(self, schema: Schema) -> CdrType | None:
        name = normal_name(schema.name)
        if not schema.data.strip():
            return self._named(name)
        try:
            text = schema.data.decode()
            definitions = parse_msg(text, name) if schema.encoding == "ros2msg" else parse_idl(text)
        except (UnicodeDecodeError, DefinitionError):
            return None
        if name not in definitions:
            return None
        return CdrType(name, TypeStore(definitions), schema=schema)

    def _named(self, name: str) -> CdrType | None:
        found = self.type_named(name)
        return found if isinstance(found, CdrType) else None

    def _check_references(self, name: str, file: Path, text: str) -> None:
        definition = self.store.definition(name)
        for reference in references(definition) if definition is not None else ():
            if self.store.definition(reference) is None:
                short = reference.rpartition("/")[2]
                lines = enumerate(text.splitlines(), 1)
                line = next((number for number, source in lines if short in source.partition("#")[0]), 1)
                hint = did_you_mean(reference, self.store.names())
                raise ConfigError(f"unknown type {reference!r}", where=f"{file}:{line}", hint=hint)


def _message_files(files: Sequence[Path]) -> list[Path]:
    found: list[Path] = []
    for file in map(Path, files):
        inside = sorted(file.rglob("msg/*.msg")) if file.is_dir() else [file]
        if not inside:
            raise ConfigError("no .msg files in this directory", where=str(file), hint="expected pkg/msg/Name.msg")
        found += inside
    for file in found:
        if file.suffix != ".msg" or file.parent.name != "msg" or not file.resolve().parent.parent.name.isidentifier():
            raise ConfigError("not a file in a layout pkg/msg/Name.msg", where=str(file), hint="move or rename it")
    return [file.resolve() for file in found]


def _text(file: Path) -> str:
    try:
        return file.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the definition: {error}", where=str(file)) from error


def _first_bad_line(text: str, name: str) -> int:
    lines = text.splitlines()
    for count in range(1, len(lines) + 1):
        try:
            parse_msg("\n".join(lines[:count]) + "\n", name)
        except DefinitionError:
            return count
    return max(len(lines), 1)
