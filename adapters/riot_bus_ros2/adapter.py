"""ROS 2 over rmw_zenoh: topic names for keys, and CDR types by name, by .msg file and by a log's schema."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path

from riot_bus.types.capabilities import (
    Announcement,
    Ask,
    Offer,
    ParameterRequest,
    RecordedTopic,
    SimClock,
    Stamp,
)
from riot_bus.types.model import MessageType, Schema, TopicName
from riot_bus.types.serve import REPLY, REQUEST, part_of
from riot_bus.vocabulary.errors import require_package
from riot_bus_ros2.announcing import EXPRESSIONS, announcement_of
from riot_bus_ros2.attachment import Attachment, build_attachment, stamp_of
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import DefinitionError, normal_name, parse_idl, parse_recorded
from riot_bus_ros2.files import load_files
from riot_bus_ros2.keys import (
    SERVICES,
    is_topic,
    is_topic_expression,
    key_expression,
    name_of_expression,
    parse_data_key,
)
from riot_bus_ros2.live import ask_nodes, services_of
from riot_bus_ros2.offering import clock_of, offer_of, server_tokens
from riot_bus_ros2.parameters import set_parameters
from riot_bus_ros2.sources import HUMBLE, from_distribution
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import TOKENS, details_of

_CALL_TYPES = {REQUEST: "_Request", REPLY: "_Response"}
_MOST_PARSED = 1 << 21
"""Most bytes of all definitions in a log, whose parser needs up to 10 s for 1 MiB. The 163 message types of Kilted that
rosbags has take 97 kB, each with all that it contains."""
_CACHED = 1 << 14  # peers may make up names and hashes: bounds memory


class Ros2Adapter:
    """Implements `Adapter` and most of `riot_bus.types.capabilities` for ROS 2.

    Raises:
        MissingExtraError: rosbags is not installed.
    """

    name = "ros2"
    tokens = TOKENS
    announcements = EXPRESSIONS
    services: Sequence[str] = (SERVICES,)

    def __init__(self) -> None:
        require_package("rosbags", "ros2")
        self.store = TypeStore()
        self._of_schema = cache(self._parse_schema)
        self._parsed = 0
        self._forget()

    def topic(self, key: str) -> TopicName | None:
        """Return the ROS name and the type of a key; for a key expression, the name that it stands for."""
        parsed = parse_data_key(key)
        if parsed is not None:
            return TopicName(parsed.topic, parsed.type_name)
        name = name_of_expression(key)
        return None if name is None else TopicName(name)

    def key_expression(self, topic: str) -> str | None:
        """Return the key expression of a topic such as `/odom` in any domain, with any type and hash."""
        return key_expression(topic)

    def action_parts(self, name: str) -> str | None:
        """Return a key expression of the topics and services of an action: `/fibonacci/_action/*` for `/fibonacci`."""
        return f"{name}/_action/*" if is_topic_expression(name) else None

    def call_type(self, type_name: str, part: str) -> str | None:
        """Return the message type of a service's requests or replies; errors have none."""
        ending = _CALL_TYPES.get(part)
        return f"{type_name}{ending}" if ending and type_name.count("/") == 2 else None

    def announcement(self, token: str) -> Announcement | None:
        """Return what the token of a node, publisher, subscriber, service or action announces."""
        return announcement_of(token)

    def load(self, files: Sequence[Path]) -> None:
        """Register .msg, .srv, .action and .idl files in a layout `pkg/msg/Name.msg`, or directories of them.

        Raises:
            ConfigError: A file is missing, misplaced, does not parse, or names an unknown type.
        """
        try:
            load_files([Path(file) for file in files], self.store)
        finally:
            self._forget()

    def type_named(self, type_name: str) -> MessageType | None:
        """Return the type `pkg/msg/Name` (or `pkg/Name`); of services and actions only parts: `pkg/srv/X_Request`."""
        name, types = normal_name(type_name), self._types
        found = types.get(name)
        if found is None:
            store = self.store if self.store.definition(name) is not None else self.store.told(name)
            if store is not None and self._is_message(name, store):
                found = types[name] = CdrType(name, store)
        return found

    def type_of_key(self, key: str) -> MessageType | None:
        """Return the type that a key names, by a definition with the key's hash.

        A key without a hash comes from Humble, so Humble's definition takes precedence over those of later
        distributions. If no definition has the key's hash, the type is opaque.
        """
        call = part_of(key)
        if call is not None:
            return self._type_of_call(*call)
        parsed = parse_data_key(key)
        return None if parsed is None else self._hashed(parsed.type_name, parsed.type_hash)

    def missing(self, key: str) -> bool:
        """Return whether a topic's key has a type and a hash, but no known definition has that hash."""
        parsed = parse_data_key(key)
        if parsed is None or parsed.type_hash is None or "/srv/" in parsed.type_name:
            return False
        return self.store.matching(parsed.type_name, parsed.type_hash) is None

    def learn(self, key: str, tokens: Iterable[str], heard: Sequence[bytes], ask: Ask) -> MessageType | None:
        """Ask the nodes that publish on a key for a type that no other source knows; see `riot_bus_ros2.live`."""
        parsed = parse_data_key(key)
        if parsed is None or parsed.type_hash is None:
            return None
        found = ask_nodes(parsed.type_name, parsed.type_hash, services_of(key, tokens, heard), ask, self.store)
        if not found:
            return None
        self.store.learn(parsed.type_name, found)
        self._forget()
        return self.type_of_key(key)

    def type_names(self) -> list[str]:
        """Return the names of all message types that need no search in files."""
        return [name for name in self.store.names() if "/msg/" in name or self._is_message(name, self.store)]

    def type_of_schema(self, schema: Schema) -> MessageType | None:
        """Return the type that a log's definitions describe; in that log they override what is installed."""
        if schema.encoding not in ("ros2msg", "ros2idl"):
            return None
        return self._of_schema(schema)

    def offer(self, topic: RecordedTopic, *, name: str | None, domain: int | None) -> Offer | None:
        """Return how to publish a topic of a bag, or of rmw_zenoh."""
        return offer_of(topic, name=name, domain=domain, type_hash=self._type_hash)

    def clock(self, topics: Sequence[RecordedTopic], *, domain: int | None) -> SimClock:
        """Return how to publish `/clock`."""
        return clock_of(topics, domain=domain, type_hash=self.store.type_hash("rosgraph_msgs/msg/Clock"))

    def server_tokens(self, key: str, zid: str, entity: int) -> Sequence[str]:
        """Return the tokens of a node and its service server, as rmw_zenoh announces them."""
        found = parse_data_key(key)
        return () if found is None or "/srv/" not in found.type_name else server_tokens(found, zid, entity)

    def has_parameters(self, node: str) -> bool:
        """Return whether a text is the full name of a node, such as `/planner`."""
        return is_topic(node)

    def set_parameters(self, request: ParameterRequest) -> Mapping[str, str]:
        """Set parameters of a node by its service; see `riot_bus_ros2.parameters`."""
        return set_parameters(
            request,
            store=self.store,
            tokens=self.tokens,
            announcement=self.announcement,
            attachment=self._request_attachment,
        )

    def _request_attachment(self) -> bytes:
        return build_attachment(Attachment(1, time.time_ns(), os.urandom(16)))

    def stamp(self, attachment: bytes) -> Stamp | None:
        """Return the content of an attachment of rmw_zenoh."""
        return stamp_of(attachment)

    def details(self, key: str, tokens: Iterable[str]) -> Mapping[str, str]:
        """Return the offered QoS of a topic's publishers."""
        return details_of(key, tokens)

    def definition(self, key: str) -> tuple[Schema, str] | None:
        """Return the name of a topic's type, whether it is known or not."""
        found = parse_data_key(key)
        return None if found is None else (Schema(found.type_name, "ros2msg", b""), "cdr")

    def _type_hash(self, topic: RecordedTopic, type_name: str) -> str | None:
        found = self.type_of_schema(topic.schema) or self.type_named(type_name)
        try:
            return found.type_hash if isinstance(found, CdrType) else None
        except KeyError:  # it has members of unknown types
            return None

    def _type_of_call(self, key: str, part: str) -> CdrType | None:
        """Return the type of a service's requests or replies; the hash in its key is that of the service."""
        parsed = parse_data_key(key)
        name = None if parsed is None else self.call_type(parsed.type_name, part)
        if parsed is None or name is None:
            return None
        store = self.store if parsed.type_hash is None else self.store.matching(parsed.type_name, parsed.type_hash)
        if store is not None:
            return self._part(name, store)
        if self._named(name) is None:
            return None
        return CdrType(
            name, self.store, opaque=f"the definition of {parsed.type_name} here is another one than the key's"
        )

    def _forget(self) -> None:
        """Look types up again; a lookup in progress writes its outdated result where nothing reads it."""
        self._types: dict[str, CdrType] = {}
        self._hashed = lru_cache(_CACHED)(self._make_hashed)

    def _make_hashed(self, name: str, wanted: str | None) -> CdrType | None:
        if wanted is None:
            store: TypeStore | None = self.store.preferring(from_distribution(HUMBLE), to_distributions=True)
        else:
            store = self.store.matching(name, wanted)
        if store is not None:
            return self._part(name, store)
        known = self._part(name, self.store)
        if known is None:
            return None
        try:
            reason = f"the definition of {name} here is another one than the key's: {known.type_hash}"
        except KeyError as unknown:
            reason = f"type {unknown.args[0]} is unknown"
        return CdrType(name, self.store, schema=Schema(name, "ros2msg", b""), opaque=reason)

    def _part(self, name: str, store: TypeStore) -> CdrType | None:
        if store is self.store:
            return self._named(name)
        return CdrType(name, store) if self._is_message(name, store) else None

    @staticmethod
    def _is_message(name: str, store: TypeStore) -> bool:
        """Return whether this is a known message, not a service or action, which have no payloads of their own."""
        if name.count("/") != 2 or store.definition(name) is None:
            return False
        kind = name.split("/")[1]
        parts = {"srv": ("Request",), "action": ("Request", "Goal")}.get(kind, ())
        return not any(store.definition(f"{name}_{part}") is not None for part in parts)

    def _parse_schema(self, schema: Schema) -> CdrType | None:
        name = normal_name(schema.name)
        if not schema.data.strip():
            return self._named(name)
        self._parsed += len(schema.data)
        if self._parsed > _MOST_PARSED:
            reason = f"the definitions in this log have more than {_MOST_PARSED} bytes"
            return CdrType(name, self.store, schema=schema, opaque=reason)
        try:
            text = schema.data.decode()
            definitions = parse_recorded(text, name) if schema.encoding == "ros2msg" else parse_idl(text)
        except (UnicodeDecodeError, DefinitionError):
            return None
        if name not in definitions:
            return None
        return CdrType(name, TypeStore(definitions), schema=schema)

    def _named(self, name: str) -> CdrType | None:
        found = self.type_named(name)
        return found if isinstance(found, CdrType) else None
