"""Which type the messages of a key have: declared by the user, named by the key, known from a log, or inferred."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, TypeVar

from riot_bus.errors import ConfigError, MissingExtraError, PayloadError, did_you_mean
from riot_bus.selector import key_matches
from riot_bus.types.json_type import JsonType
from riot_bus.types.model import TopicName
from riot_bus.types.msgpack_type import MsgpackType, is_container
from riot_bus.types.offer import Offering
from riot_bus.types.stamp import Stamping

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.types.model import Adapter, MessageType, Schema

__all__ = ["TypeRegistry", "load_adapters"]

KeyT = TypeVar("KeyT")
ValueT = TypeVar("ValueT")

_GROUP = "riot_bus.adapters"
_BUILT_IN = {"ros2": "riot_bus_ros2.adapter:Ros2Adapter"}
_CACHED_KEYS = 1 << 14

_JSON = JsonType()
_MSGPACK = MsgpackType()
_ENCODINGS: dict[str, MessageType] = {
    "application/json": _JSON,
    "text/json": _JSON,
    "json": _JSON,
    "application/msgpack": _MSGPACK,
    "application/x-msgpack": _MSGPACK,
    "application/vnd.msgpack": _MSGPACK,
    "msgpack": _MSGPACK,
}
_UNTYPED = frozenset({"", "zenoh/bytes", "zenoh/string", "zenoh/serialized", "text/plain", "application/octet-stream"})


class TypeRegistry:
    """Names keys as people do and finds the type of their messages; a few dictionary lookups per message.

    Args:
        adapters: Asked in this order.
        declared: Type names by topic name or key expression, as in `riot.toml`.

    Raises:
        ConfigError: A declared type is unknown.
    """

    def __init__(self, adapters: Sequence[Adapter] = (), *, declared: Mapping[str, str] | None = None) -> None:
        self._adapters = tuple(adapters)
        self._names: dict[str, TopicName] = {}
        self._matches: dict[tuple[str, str], bool] = {}
        self._settled: dict[str, MessageType | None] = {}
        self._inferred: dict[str, MessageType] = {}
        self._from_logs: dict[str, MessageType] = {}
        self._types: dict[str, MessageType] = {"json": _JSON, "msgpack": _MSGPACK}
        self._declared: dict[str, MessageType] = {}
        for topic, type_name in (declared or {}).items():
            found = self.type_named(type_name)
            if found is None:
                hint = did_you_mean(type_name, self._types) if "/" not in type_name else None
                raise ConfigError(
                    f"unknown message type {type_name!r}", where=topic, hint=hint or "name its definition files"
                )
            self._declared[topic] = found

    def topic(self, key: str) -> str:
        """Return what people call the key; the key itself if no adapter knows it."""
        return self._name(key).name

    def key_expression(self, topic: str) -> str:
        """Return the key expression to subscribe to for a topic name; key expressions stay as they are."""
        for adapter in self._adapters:
            expression = adapter.key_expression(topic)
            if expression is not None:
                return expression
        return topic

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
        """Return the type of the key's messages, None if nothing tells.

        In order: declared, named by the key, from a log's schema, named by the encoding, inferred from the payload.

        Args:
            key: Key of a message.
            payload: A sample from which JSON and MessagePack may be inferred.
            encoding: Zenoh's or MCAP's encoding string.
        """
        try:
            settled = self._settled[key]
        except KeyError:
            settled = self._settle(key)
            _remember(self._settled, key, settled)
        if settled is not None:
            return settled
        if encoding not in _UNTYPED:
            return self._by_encoding(encoding)
        inferred = self._inferred.get(key)
        if inferred is None and payload is not None:
            inferred = _infer(payload)
            if inferred is not None:
                _remember(self._inferred, key, inferred)
        return inferred

    def add_schema(self, key_or_topic: str, schema: Schema, encoding: str) -> MessageType | None:
        """Take in what a log says about a topic's type.

        Args:
            key_or_topic: Key or topic name of the log's channel.
            schema: The channel's schema.
            encoding: The channel's message encoding.

        Returns:
            The type, None if no adapter understands the schema.
        """
        found = _ENCODINGS.get(encoding)
        for adapter in self._adapters:
            found = found or adapter.type_of_schema(schema)
        if found is not None:
            self._from_logs[key_or_topic] = found
            self._types.setdefault(found.name, found)
            self._settled.clear()
        return found

    def offerings(self) -> list[Offering]:
        """Return the adapters that say how topics are published."""
        return [each for each in self._adapters if isinstance(each, Offering)]

    def stampings(self) -> list[Stamping]:
        """Return the adapters that read what messages and publishers say of themselves."""
        return [each for each in self._adapters if isinstance(each, Stamping)]

    def stamping(self, key: str) -> Stamping | None:
        """Return the one that does so for a key, None if there is none."""
        for adapter in self._adapters:
            if isinstance(adapter, Stamping) and adapter.topic(key) is not None:
                return adapter
        return None

    def type_named(self, name: str) -> MessageType | None:
        """Return the type of this name, None if no adapter and no log has it."""
        found = self._types.get(name)
        if found is None:
            for adapter in self._adapters:
                found = found or adapter.type_named(name)
            if found is not None:
                self._types[name] = found
        return found

    def _name(self, key: str) -> TopicName:
        name = self._names.get(key)
        if name is None:
            found = (adapter.topic(key) for adapter in self._adapters)
            name = next((each for each in found if each is not None), TopicName(key))
            _remember(self._names, key, name)
        return name

    def _settle(self, key: str) -> MessageType | None:
        name = self._name(key)
        for exact in (key, name.name):
            if exact in self._declared:
                return self._declared[exact]
        for pattern, declared in self._declared.items():
            if self.matches(pattern, key):
                return declared
        by_key = self.type_named(name.type_name) if name.type_name is not None else None
        return by_key or self._from_logs.get(key) or self._from_logs.get(name.name)

    def _by_encoding(self, encoding: str) -> MessageType | None:
        base, _, schema = encoding.partition(";")
        return _ENCODINGS.get(base) or (self.type_named(schema) if schema else None)


def _remember(cache: dict[KeyT, ValueT], key: KeyT, value: ValueT) -> None:
    if len(cache) >= _CACHED_KEYS:
        cache.clear()
    cache[key] = value


def _infer(payload: bytes) -> MessageType | None:
    if is_container(payload):
        return _MSGPACK
    if payload.lstrip(b" \t\r\n")[:1] in (b"{", b"["):
        try:
            _JSON.leaves(payload, elements=0)
        except PayloadError:
            return None
        return _JSON
    return None


def load_adapters(names: Iterable[str] | None = None) -> list[Adapter]:
    """Load adapters by the entry points `riot_bus.adapters`.

    Args:
        names: Which; None for all whose dependencies are installed.

    Raises:
        ConfigError: A named adapter does not exist, or cannot be loaded.
        MissingExtraError: A named adapter lacks its optional dependency.
    """
    targets = _BUILT_IN | {point.name: point.value for point in entry_points(group=_GROUP)}
    loaded: list[Adapter] = []
    for name in sorted(targets) if names is None else names:
        if name not in targets:
            raise ConfigError(f"unknown adapter {name!r}", hint=did_you_mean(name, targets))
        try:
            loaded.append(_load(name, targets[name]))
        except MissingExtraError:
            if names is not None:
                raise
    return loaded


def _load(name: str, target: str) -> Adapter:
    module, _, attribute = target.partition(":")
    try:
        adapter: Adapter = getattr(import_module(module), attribute)()
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"adapter {name!r} cannot be loaded: {error}", where=target, hint="mend or uninstall the package"
        ) from error
    return adapter
