"""MAVLink adapter: forms keys, finds message types in a dialect, the user's XML or the definitions of a log."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path

from riot_bus.types.capabilities import ParameterRequest
from riot_bus.types.model import Schema, TopicName
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean, require_package
from riot_bus.vocabulary.message import Message
from riot_bus_mavlink.definitions import MessageTable
from riot_bus_mavlink.dialect import DEFAULT, Dialect, load_dialect
from riot_bus_mavlink.frame import checksum_fits, parse_frame
from riot_bus_mavlink.keys import TEMPLATE, KeyTemplate
from riot_bus_mavlink.message_type import PREFIX, MavlinkType
from riot_bus_mavlink.parameters import set_parameters
from riot_bus_mavlink.schema_text import ENCODING, parse_schema
from riot_bus_mavlink.signing import Signer, read_key
from riot_bus_mavlink.tlog import TlogUnpacker, tlog_record

_OPTIONS = ("dialect", "key_file", "template")
_COMPONENT = re.compile(r"([1-9][0-9]{0,2})/([1-9][0-9]{0,2})", re.ASCII)
_SHORT = re.compile(r"(?:([0-9]{1,3}|\*)/([0-9]{1,3}|\*)/)?([A-Z][A-Z0-9_]*)")


class MavlinkAdapter:
    """Implements `Adapter` and some of `riot_bus.types.capabilities` for MAVLink frames, one in each payload.

    Args:
        options: A dialect's name, or any of `dialect=NAME;key_file=FILE;template=KEY`: the key that re-signs changed
            signed frames, and the template of the keys on the bus (see `riot_bus_mavlink.keys`).

    Raises:
        MissingExtraError: pymavlink or fastcrc is not installed.
        ConfigError: There is no such option, the template is wrong, or the key cannot be read.
    """

    name = "mavlink"
    endings: Sequence[str] = (".xml",)
    archives: Sequence[str] = (".tlog",)

    def __init__(self, options: str = "") -> None:
        for package in ("pymavlink", "fastcrc"):
            require_package(package, "mavlink")
        chosen = _options(options)
        self.template = KeyTemplate(chosen.get("template", TEMPLATE))
        self.signer = Signer(read_key(Path(chosen["key_file"]))) if "key_file" in chosen else None
        self._dialect_name = chosen.get("dialect", DEFAULT)
        self._files: list[Path] = []
        self._types: dict[str, MavlinkType] = {}
        self._of_schema = cache(self._parse_schema)
        if "dialect" in chosen:
            load_dialect(self._dialect_name)  # reports a wrong name at once

    @cached_property
    def dialect(self) -> Dialect:
        """The messages that are known."""
        return load_dialect(self._dialect_name, self._files)

    def topic(self, key: str) -> TopicName | None:
        """Return the key and the type that it names, None if it does not match the template."""
        parsed = self.template.parse(key)
        return None if parsed is None else TopicName(key, PREFIX + parsed.message)

    def key_expression(self, topic: str) -> str | None:
        """Return the key expression of `HEARTBEAT` (any source), `1/1/HEARTBEAT` or `1/*/HEARTBEAT`."""
        match = _SHORT.fullmatch(topic)
        if match is None or self.dialect.message(match[3]) is None:
            return None
        return self.template.expression("*", match[1] or "*", match[2] or "*", match[3])

    def load(self, files: Sequence[Path]) -> None:
        """Load dialects from XML files, which may include those that pymavlink ships.

        Raises:
            ConfigError: A file is missing or wrong; then nothing changes.
        """
        wanted = [*self._files, *map(Path, files)]
        self.dialect = load_dialect(self._dialect_name, wanted)
        self._files = wanted
        self._types.clear()
        self._of_schema.cache_clear()

    def type_named(self, type_name: str) -> MavlinkType | None:
        """Return the type `mavlink/HEARTBEAT`."""
        if not type_name.startswith(PREFIX):
            return None
        found = self._types.get(type_name)
        if found is None:
            message = self.dialect.message(type_name.removeprefix(PREFIX))
            if message is None:
                return None
            found = self._types[type_name] = self._type(message, self.dialect)
        return found

    def type_names(self) -> list[str]:
        """Return the names of all types."""
        return [PREFIX + message.name for message in self.dialect.messages.values()]

    def type_of_schema(self, schema: Schema) -> MavlinkType | None:
        """Return the type that a log's definition describes; in that log it overrides the loaded dialect.

        If both agree on the message, the dialect's type is returned, which also knows command parameters and all enums.
        """
        return self._of_schema(schema) if schema.encoding == ENCODING else None

    def unpacker(self) -> TlogUnpacker:
        """Return an unpacker of telemetry logs; its messages belong to a link called `tlog`."""
        return TlogUnpacker(self.dialect, self.template)

    def packed(self, message: Message) -> bytes | None:
        """Return a message as a record of a telemetry log, None if it is not a MAVLink frame."""
        if message.kind == "delete" or message.payload[:1] not in (b"\xfe", b"\xfd"):
            return None
        try:
            frame = parse_frame(message.payload)
        except PayloadError:
            return None
        extra = self.dialect.crc_extra(frame.message_id)
        if not checksum_fits(frame, extra) if extra is not None else self.topic(message.key) is None:
            return None
        return tlog_record(message.time, message.payload)

    def has_parameters(self, node: str) -> bool:
        """Return whether a text names a component, such as `1/1`: the ids of its system and its own."""
        match = _COMPONENT.fullmatch(node)
        return (
            match is not None and max(map(int, match.groups())) <= 255 and self.dialect.message("PARAM_SET") is not None
        )

    def set_parameters(self, request: ParameterRequest) -> Mapping[str, str]:
        """Set parameters of a component by PARAM_SET; see `riot_bus_mavlink.parameters`."""
        return set_parameters(request, dialect=self.dialect, keys=self.template)

    def _parse_schema(self, schema: Schema) -> MavlinkType | None:
        here = self.type_named(schema.name)
        found = parse_schema(schema)
        if found is None:
            return here if not schema.data.strip() else None
        message = found.messages[0]
        if here is not None and (here.message.id, here.message.places) == (message.id, message.places):
            return here
        return self._type(message, Dialect(schema.name, [found]))

    def _type(self, message: MessageTable, dialect: Dialect) -> MavlinkType:
        return MavlinkType(message, dialect.enums, signer=self.signer)


def _options(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in filter(None, (each.strip() for each in text.split(";"))):
        name, equals, value = part.partition("=")
        if not equals:
            name, value = "dialect", part
        if name not in _OPTIONS or name in found or not value:
            hint = did_you_mean(name, _OPTIONS)
            raise ConfigError(f"{part!r} is not an option of the adapter mavlink", hint=hint)
        found[name] = value
    return found
