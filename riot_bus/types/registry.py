"""The registry of message types by key: declared by the user, named by the key, known from a log, or inferred."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TypeVar

from riot_bus.plugins import ADAPTERS
from riot_bus.types.capabilities import (
    Announcement,
    AnnouncesServers,
    Ask,
    DiscoversTypes,
    HasServices,
    ListsTypes,
    ParsesTokens,
    PublishesAs,
    ReadsMetadata,
    ReadsTypesFromKeys,
    SetsParameters,
    TakesFiles,
)
from riot_bus.types.codecs import Codecs
from riot_bus.types.model import Adapter, MessageType, Schema, TopicName, TypeSource
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.types.serve import part_of
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, did_you_mean
from riot_bus.vocabulary.message import CACHED_KEYS, Message
from riot_bus.vocabulary.selector import key_matches

KeyT = TypeVar("KeyT")
ValueT = TypeVar("ValueT")

_VARIABLE = "RIOT_ADAPTERS"
_LONGEST_ENCODING = 1 << 8  # with `CACHED_KEYS`, bounds the cached texts at 4 MiB

_MSGPACK = MsgpackType()
_UNTYPED = frozenset({"", "zenoh/bytes", "zenoh/string", "zenoh/serialized", "text/plain", "application/octet-stream"})


class TypeRegistry:
    """Finds topic names of keys and types of their messages, with a few dictionary lookups per message.

    Args:
        adapters: Adapters, asked in this order.
        declared: Type names by topic name or key expression, as in `riot.toml`.
        definitions: Files that define types; codecs and adapters take files with their own endings, adapters without
            endings take the rest.

    Raises:
        ConfigError: A declared type is unknown, or a file does not define one.
        MissingExtraError: A required codec is not installed.
    """

    def __init__(
        self,
        adapters: Sequence[Adapter] = (),
        *,
        declared: Mapping[str, str] | None = None,
        definitions: Sequence[Path] = (),
    ) -> None:
        self._adapters = tuple(adapters)
        # Looked up once: checking whether an object implements a protocol is far slower than a dictionary lookup.
        self._token_parsers = [each for each in self._adapters if isinstance(each, ParsesTokens)]
        self._key_readers = [each for each in self._adapters if isinstance(each, ReadsTypesFromKeys)]
        self._discoverers = [each for each in self._adapters if isinstance(each, DiscoversTypes)]
        self._publishing = [each for each in self._adapters if isinstance(each, PublishesAs)]
        self._with_services = [each for each in self._adapters if isinstance(each, HasServices)]
        self._metadata_readers = [each for each in self._adapters if isinstance(each, ReadsMetadata)]
        self._codecs = Codecs()
        self._names: dict[str, TopicName] = {}
        self._matches: dict[tuple[str, str], bool] = {}
        self._settled: dict[str, MessageType | None] = {}
        self._inferred: dict[str, MessageType] = {}
        self._from_logs: dict[str, MessageType] = {}
        self._named_in_logs: dict[str, MessageType] = {}
        self._refined: dict[str, MessageType] = {}
        self._encoded: dict[str, MessageType | None] = {}
        self._types: dict[str, MessageType] = {}
        self._declared: dict[str, MessageType] = {}
        self._load(definitions)
        for topic, type_name in (declared or {}).items():
            found = self.type_named(type_name)
            if found is None:
                known = {*self._types, *self.type_names()}
                hint = did_you_mean(type_name, known) if "/" not in type_name else None
                raise ConfigError(
                    f"unknown message type {type_name!r}", where=topic, hint=hint or "name its definition files"
                )
            self._declared[topic] = found

    def topic(self, key: str) -> str:
        """Return the topic name of a key; the key itself if no adapter knows it."""
        return self._name(key).name

    def key_expression(self, topic: str) -> str:
        """Return the key expression to subscribe to for a topic name; key expressions stay as they are."""
        call = part_of(topic)
        if call is not None:
            return f"{self.key_expression(call[0])}/{call[1]}"
        expression = _first(adapter.key_expression(topic) for adapter in self._adapters)
        return topic if expression is None else expression

    def matches(self, topic_or_expression: str, key: str) -> bool:
        """Return whether a topic name or key expression, as a user wrote it, includes the key."""
        question = (topic_or_expression, key)
        answer = self._matches.get(question)
        if answer is None:
            answer = topic_or_expression == self.topic(key) or key_matches(
                self.key_expression(topic_or_expression), key
            )
            _remember(self._matches, question, answer)
        return answer

    def type_of(self, key: str, *, payload: bytes | None = None, encoding: str = "") -> MessageType | None:
        """Return the type of the key's messages, None if it is unknown.

        Sources in order: refined, declared, from a log's schema for this key, named by the key, from a log's schema for
        a topic of its name, named by a log without definition, named by the encoding, inferred from the payload.

        Args:
            key: Key of a message.
            payload: Sample payload from which JSON and MessagePack may be inferred.
            encoding: Encoding string of Zenoh or MCAP.
        """
        known = self._settled
        try:
            settled = known[key]
        except KeyError:
            settled = self._settle(key)
            _remember(known, key, settled)
        if settled is not None:
            return settled
        if encoding not in _UNTYPED:
            return self._by_encoding(encoding)
        inferred = self._inferred.get(key)
        if inferred is None and payload is not None:
            inferred = self._infer(payload)
            if inferred is not None:
                _remember(self._inferred, key, inferred)
        return inferred

    def type_of_message(self, message: Message) -> MessageType | None:
        """Return the type of a message, None if it is unknown."""
        return self.type_of(message.key, payload=message.payload, encoding=message.encoding)

    def add_schema(self, key_or_topic: str, schema: Schema, encoding: str) -> MessageType | None:
        """Add what a log says about a topic's type.

        Args:
            key_or_topic: Key or topic name of the log's channel.
            schema: The channel's schema.
            encoding: The channel's message encoding.

        Returns:
            The type, None if neither a codec nor an adapter understands the schema.
        """
        codec = self._codecs.of_encoding(encoding)
        sources = [*([codec] if isinstance(codec, TypeSource) else []), *self._adapters]
        found = codec if isinstance(codec, MessageType) else _first(each.type_of_schema(schema) for each in sources)
        if found is not None:
            by_name = not schema.data and found.schema is not None and found.schema.data  # only from the log
            (self._named_in_logs if by_name else self._from_logs)[key_or_topic] = found
            self._types.setdefault(found.name, found)
            self._forget()
        return found

    def refine(self, key: str, kind: MessageType) -> None:
        """Let a key have a type that knows more than the one found so far, such as one that was learnt from a log."""
        self._refined[key] = kind
        self._forget()

    def announcements(self) -> list[str]:
        """Return the key expressions of the liveliness tokens that adapters understand."""
        return list(dict.fromkeys(text for each in self._token_parsers for text in each.announcements))

    def announcement(self, token: str) -> Announcement | None:
        """Return a token's announcement, None if no adapter reads it; an adapter may learn a key's type from it."""
        found = _first(adapter.announcement(token) for adapter in self._token_parsers)
        if found is not None:
            self._names.pop(found.key, None)
            self._settled.pop(found.key, None)
        return found

    def missing(self, key: str) -> bool:
        """Return whether the type of a key is unknown, but participants that use the key can be asked for it."""
        if self._declared_for(key, self._name(key)) is not None:
            return False
        return any(each.missing(key) for each in self._discoverers)

    def learn(self, key: str, tokens: Iterable[str], heard: Sequence[bytes], ask: Ask) -> bool:
        """Ask participants that use a key for its type, which may take long.

        Args:
            key: Key whose type is `missing`.
            tokens: Keys of all present liveliness tokens.
            heard: Attachments of some messages of the key.
            ask: Function that sends a query.

        Returns:
            Whether the type was learnt; then `type_of` knows it, for all keys that name the same type.
        """
        told = any(each.learn(key, tokens, heard, ask) is not None for each in self._discoverers if each.missing(key))
        if told:
            self._forget()
        return told

    def service_adapters(self) -> list[HasServices]:
        """Return the adapters that know services."""
        return list(self._with_services)

    def server_tokens(self, key: str, zid: str, entity: int) -> list[str]:
        """Return the tokens of a server, whose callers may wait for them; see `AnnouncesServers.server_tokens`."""
        found = (each.server_tokens(key, zid, entity) for each in self._adapters if isinstance(each, AnnouncesServers))
        return list(dict.fromkeys(chain.from_iterable(found)))

    def publishing_adapters(self) -> list[PublishesAs]:
        """Return the adapters that know how topics are published."""
        return list(self._publishing)

    def parameter_adapter(self, node: str) -> SetsParameters | None:
        """Return the adapter that sets parameters of a running participant, None if none knows such a name."""
        found = (each for each in self._adapters if isinstance(each, SetsParameters))
        return next((each for each in found if each.has_parameters(node)), None)

    def metadata_adapters(self) -> list[ReadsMetadata]:
        """Return the adapters that read metadata of messages and publishers."""
        return list(self._metadata_readers)

    def metadata_adapter(self, key: str) -> ReadsMetadata | None:
        """Return the adapter that reads metadata for a key, None if there is none."""
        return next((adapter for adapter in self._metadata_readers if adapter.topic(key) is not None), None)

    def type_named(self, name: str) -> MessageType | None:
        """Return the type of this name, None if no codec, no adapter and no log has it.

        Raises:
            ConfigError: It is a codec's name, and the codec cannot be loaded.
        """
        found = self._types.get(name)
        if found is None:
            found = self._of_codec(name) or _first(source.type_named(name) for source in self._sources())
            if found is not None and "(" not in name:
                self._types[name] = found
        return found

    def type_names(self) -> list[str]:
        """Return the names of all known types, from sources that can list them."""
        found = {name for name in self._codecs.names() if name != "protobuf"}
        for source in self._sources():
            found.update(source.type_names() if isinstance(source, ListsTypes) else ())
        return sorted(found)

    def _name(self, key: str) -> TopicName:
        name = self._names.get(key)
        if name is None:
            call = part_of(key)
            found = self._part(*call) if call else _first(adapter.topic(key) for adapter in self._adapters)
            name = found or TopicName(key)
            _remember(self._names, key, name)
        return name

    def _part(self, key: str, part: str) -> TopicName:
        """Return the name and the type of a part of a service's calls."""
        name = self._name(key)
        types = (each.call_type(name.type_name, part) for each in self._with_services if name.type_name is not None)
        return TopicName(f"{name.name}/{part}", _first(types))

    def _settle(self, key: str) -> MessageType | None:
        name = self._name(key)
        logged, named = self._from_logs, self._named_in_logs
        return (
            self._refined.get(key)
            or self._declared_for(key, name)
            or logged.get(key)
            or self._by_key(key, name)
            or logged.get(name.name)
            or named.get(key)
            or named.get(name.name)
        )

    def _declared_for(self, key: str, name: TopicName) -> MessageType | None:
        for exact in (key, name.name):
            if exact in self._declared:
                return self._declared[exact]
        return next((found for text, found in self._declared.items() if self.matches(text, key)), None)

    def _forget(self) -> None:
        """Forget cached types; lookups in progress write outdated results to the old dictionaries, which are unused."""
        self._settled, self._encoded = {}, {}

    def _by_key(self, key: str, name: TopicName) -> MessageType | None:
        if name.type_name is None:
            return None
        return _first(adapter.type_of_key(key) for adapter in self._key_readers) or self.type_named(name.type_name)

    def _by_encoding(self, encoding: str) -> MessageType | None:
        known = self._encoded
        try:
            return known[encoding]
        except KeyError:
            base, _, schema = encoding.partition(";")
            codec = self._codecs.of_encoding(base)
            found = codec if isinstance(codec, MessageType) else None
            if found is None and schema:
                found = self._named_by_peer(schema)
            if len(encoding) <= _LONGEST_ENCODING:  # peers may use any text as encoding
                _remember(known, encoding, found)
            return found

    def _named_by_peer(self, name: str) -> MessageType | None:
        """Return the type that a message names; None if it is unknown or invalid."""
        try:
            return self.type_named(name)
        except ConfigError:
            return None

    def _of_codec(self, name: str) -> MessageType | None:
        codec = self._codecs.of_type(name)
        if isinstance(codec, TypeSource) and "(" in name:
            return codec.type_named(name)
        return codec if isinstance(codec, MessageType) and codec.name == name else None

    def _sources(self) -> list[TypeSource]:
        return [*self._adapters, *(each for each in self._codecs.loaded() if isinstance(each, TypeSource))]

    def _load(self, definitions: Sequence[Path]) -> None:
        owners = {ending: adapter for adapter in self._adapters for ending in _endings(adapter)}
        others = []
        for file in definitions:
            source = self._codecs.of_file(file) or owners.get(file.suffix)
            if source is None:
                others.append(file)
            else:
                source.load([file])
        for adapter in self._adapters if others else ():
            if not _endings(adapter):
                adapter.load(others)

    def _infer(self, payload: bytes) -> MessageType | None:
        if _MSGPACK.is_container(payload):
            return self.type_named("msgpack")
        if payload.lstrip(b" \t\r\n")[:1] in (b"{", b"["):
            found = self.type_named("json")
            return found if found is not None and found.opaque(payload) is None else None
        return None


def _endings(adapter: Adapter) -> Sequence[str]:
    """Return the endings of the files that an adapter takes, empty if it takes all files that no other takes."""
    return adapter.endings if isinstance(adapter, TakesFiles) else ()


def _first(found: Iterable[ValueT | None]) -> ValueT | None:
    """Return the first result that is not None; those after it are not computed."""
    return next((each for each in found if each is not None), None)


def _remember(cache: dict[KeyT, ValueT], key: KeyT, value: ValueT) -> None:
    if len(cache) >= CACHED_KEYS:
        cache.clear()
    cache[key] = value


def chosen_adapters(otherwise: Iterable[str] | None = None) -> list[str] | None:
    """Return the adapters named in the environment variable `RIOT_ADAPTERS`, separated by commas.

    Args:
        otherwise: Adapters to return if there are none, such as those of riot.toml; None for the default ones.
    """
    named = [name.strip() for name in os.environ.get(_VARIABLE, "").split(",") if name.strip()]
    return named or (None if otherwise is None else list(otherwise))


def load_adapters(names: Iterable[str] | None = None) -> list[Adapter]:
    """Load adapters by the entry points `riot_bus.adapters`.

    Args:
        names: Adapters as `NAME` or `NAME:ARGUMENT`; None for those in `RIOT_ADAPTERS`, or if there are none, for all
            whose dependencies are installed and that are not marked `on_request`.

    Raises:
        ConfigError: A named adapter does not exist, or cannot be loaded.
        MissingExtraError: The optional dependency of a named adapter is not installed.
    """
    named = chosen_adapters() if names is None else list(names)
    loaded: list[Adapter] = []
    for text in ADAPTERS.targets() if named is None else named:
        name, _, argument = text.partition(":")
        made: Callable[..., Adapter] = ADAPTERS.load(name)
        if named is None and getattr(made, "on_request", False):
            continue
        try:
            loaded.append(made(argument) if argument else made())
        except MissingExtraError:
            if named is not None:
                raise
        except TypeError as error:
            if not argument:
                raise
            raise ConfigError(f"adapter {name!r} does not take {argument!r}", hint=f"write {name} alone") from error
    return loaded
