"""Chooses the channels of a log from which selected fields are read, and their types."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from riot_bus.types.bulk import gather
from riot_bus.types.capabilities import DescribesFields, GathersFields
from riot_bus.types.fields import MOST_FIELDS, FieldType
from riot_bus.types.listing import TypeListing, describe
from riot_bus.types.payloads import Payloads
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean
from riot_bus.vocabulary.predicate import Predicate, parse_predicate
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from riot_bus.log.reader import ChannelSource, LogReader
    from riot_bus.types.model import MessageType
    from riot_bus.vocabulary.message import Scalar

_SAMPLES = 16  # a guess: without a definition, the first few messages mostly show type and fields
_MOST_SAMPLED = 100_000  # else a topic with fewer than 16 messages would have the whole log read
_MOST_LISTED = 10 * MOST_FIELDS  # of all topics, which may be 60,000 with so many fields each
_INDEX = re.compile(r"\[\d+\]")
_LEFT_OUT = f"not listed after {_MOST_LISTED} fields of other topics: name this topic with --topics"
NOTHING = Payloads(b"", np.zeros(0, np.int64), np.zeros(0, np.int64))
"""No payloads: gathering a field of them tells its type."""


@dataclass(frozen=True, slots=True)
class Wish:
    """A parsed selector: a field of the messages of a topic that meet a predicate."""

    text: str
    topic: str
    path: str
    where: Predicate | None


@dataclass(slots=True)
class Feed:
    """A channel that fields are read from.

    Attributes:
        number: The channel's number in the file.
        source: Topic, key, schema and encoding of its messages.
        wishes: Indices of the wishes that read from it.
        kind: Type of its messages, None while it is unknown.
    """

    number: int
    source: ChannelSource
    wishes: list[int] = field(default_factory=list)
    kind: MessageType | None = None

    def settle(self, payloads: Payloads, registry: TypeRegistry) -> MessageType | None:
        """Return the type of these messages, derived from the first payloads if it is unknown."""
        if self.kind is None and len(payloads):
            for payload in payloads.take(np.arange(min(len(payloads), _SAMPLES))):
                self.kind = registry.type_of(self.source.key, payload=payload, encoding=self.source.payload_encoding)
                if self.kind is not None:
                    break
        return self.kind


def log_registry(
    *readers: LogReader, declared: dict[str, str] | None = None, definitions: Sequence[Path] = ()
) -> TypeRegistry:
    """Return a registry of the types of a log's messages.

    Raises:
        ConfigError: A declared type is unknown, or a file does not define one.
    """
    registry = TypeRegistry(load_adapters(), declared=declared, definitions=definitions)
    for source in (source for reader in readers for source in reader.sources().values()):
        if source.role == "delivered" and (source.schema.name or source.encoding):
            registry.add_schema(source.key, source.schema, source.encoding)
    return registry


def plan_columns(reader: LogReader, selectors: Sequence[str], registry: TypeRegistry) -> tuple[list[Wish], list[Feed]]:
    """Return the parsed selectors, and the channels to read them from.

    Raises:
        ConfigError: A selector names no field, a topic that the log does not have, or one of an unknown type.
        PayloadError: The type has no such field.
    """
    wishes = [_wish(text) for text in dict.fromkeys(selectors)]
    if not wishes:
        raise ConfigError("no field is wanted", hint="name at least one, such as '/odom:pose.pose.position.x'")
    delivered = delivered_sources(reader, registry)
    feeds: dict[int, Feed] = {}
    for place, wish in enumerate(wishes):
        problem: PayloadError | ConfigError | None = None
        found = False
        for number, source in delivered.items():
            if not is_chosen(source, [wish.topic], registry):
                continue
            feed = feeds.get(number) or Feed(number, source)
            try:
                _check(feed, wish, registry)
            except (PayloadError, ConfigError) as error:
                problem = problem or error
                continue
            found = True
            feed.wishes.append(place)
            feeds[number] = feed
        if found:
            continue
        if problem is not None:
            raise problem
        raise _no_topic(reader, wish.topic, delivered)
    return wishes, list(feeds.values())


def delivered_sources(
    reader: LogReader, registry: TypeRegistry, topics: Sequence[str] | None = None
) -> dict[int, ChannelSource]:
    """Return the channels of delivered messages by number.

    Raises:
        ConfigError: The log has no such topic.
    """
    found = {number: source for number, source in reader.sources().items() if source.role == "delivered"}
    for topic in topics or ():
        if not any(is_chosen(source, [topic], registry) for source in found.values()):
            raise _no_topic(reader, topic, found)
    return {number: source for number, source in found.items() if is_chosen(source, topics, registry)}


def _no_topic(reader: LogReader, topic: str, sources: Mapping[int, ChannelSource]) -> ConfigError:
    topics = {source.topic for source in sources.values()}
    return ConfigError(f"no topic {topic!r} in the log", where=reader.path, hint=did_you_mean(topic, topics))


def is_chosen(source: ChannelSource, topics: Sequence[str] | None, registry: TypeRegistry) -> bool:
    """Return whether a channel has one of these topics, by its name in the log or by a name that adapters know."""
    return source.chosen(topics) or any(registry.matches(topic, source.key) for topic in topics or ())


def topic_types(
    reader: LogReader, registry: TypeRegistry, topics: Sequence[str] | None = None
) -> list[tuple[str, TypeListing]]:
    """Return each topic of a log and its type; without a definition, the fields are those of the first messages.

    Raises:
        ConfigError: The log has no such topic.
    """
    sources = delivered_sources(reader, registry, topics).values()
    kinds = {source.key: registry.type_of(source.key, encoding=source.payload_encoding) for source in sources}
    samples = _samples(reader, {key for key, kind in kinds.items() if not isinstance(kind, DescribesFields)})
    found: dict[tuple[str, str], TypeListing] = {}
    left = _MOST_LISTED
    for source in sources:
        some = samples.get(source.key, [])
        kind = kinds[source.key] or registry.type_of(source.key, payload=some[0] if some else None)
        if kind is None:
            problem = "no definition" if source.schema.name else ""
            listing = TypeListing(source.schema.name, source.encoding, problem=problem)
        else:
            listing = describe(kind) if left > 0 else TypeListing(kind.name, kind.encoding, problem=_LEFT_OUT)
            left -= len(listing.fields)
            if not listing.fields and not listing.problem:
                fields = tuple(_fields_of(kind, some))
                why = next((why for payload in some if (why := kind.opaque(payload))), "") if not fields else ""
                listing = TypeListing(kind.name, kind.encoding, fields, problem=f"opaque: {why}" if why else "")
        found.setdefault((source.topic, source.key), listing)
    return sorted(((topic, listing) for (topic, _), listing in found.items()), key=lambda each: each[0])


def _samples(reader: LogReader, keys: set[str]) -> dict[str, list[bytes]]:
    """Return the first payloads of each key, none for a key that first appears late in a long log."""
    found: dict[str, list[bytes]] = {key: [] for key in keys}
    missing = len(keys)
    for message in islice(reader.messages(topics=sorted(keys)), _MOST_SAMPLED) if keys else ():
        some = found.get(message.key)
        if some is not None and len(some) < _SAMPLES:
            some.append(message.payload)
            missing -= len(some) == _SAMPLES
            if not missing:
                break
    return found


def _fields_of(kind: MessageType, samples: Sequence[bytes]) -> list[FieldType]:
    found: dict[str, FieldType] = {}
    for payload in samples:
        try:
            leaves = kind.leaves(payload)
        except PayloadError:
            continue
        for leaf in leaves:
            path = _INDEX.sub("[*]", leaf.path)
            found.setdefault(path, FieldType(path, leaf.type))
    return list(found.values())[:MOST_FIELDS]


def _wish(text: str) -> Wish:
    selector = parse_selector(text)
    if selector.field is None:
        raise ConfigError(
            f"{text!r} names no field", hint=f"write '{selector.topic}:FIELD'; 'riot types LOG' lists the fields"
        )
    if "[*]" in selector.field:
        raise ConfigError(f"{text!r} names many fields", hint="name one element, such as 'ranges[3]'")
    where = parse_predicate(selector.where) if selector.where is not None else None
    return Wish(text, selector.topic, selector.field, where)


def _check(feed: Feed, wish: Wish, registry: TypeRegistry) -> None:
    """Raise an error if messages of a channel cannot have the fields of a wish."""
    source = feed.source
    if feed.kind is None:
        feed.kind = registry.type_of(source.key, encoding=source.payload_encoding)
    if feed.kind is None:
        if source.schema.name:
            raise ConfigError(
                f"the type {source.schema.name!r} of {source.topic!r} is not known",
                hint="name its definition with --msg FILE, or another type with --type TOPIC=TYPE",
            )
        return
    if isinstance(feed.kind, GathersFields):
        for path in (wish.path, *(wish.where.fields if wish.where is not None else ())):
            gather(feed.kind, NOTHING, path)


def chosen_rows(kind: MessageType, payloads: Payloads, where: Predicate) -> NDArray[np.bool_]:
    """Return which payloads meet a predicate; those that lack its fields do not."""
    gathered = {path: gather(kind, payloads, path) for path in where.fields}
    columns = {path: (found.values.tolist(), found.valid.tolist()) for path, found in gathered.items()}
    return np.array([where.holds(partial(_read, columns, row)) for row in range(len(payloads))], np.bool_)


def _read(columns: dict[str, tuple[list[Scalar], list[bool]]], row: int, path: str) -> Scalar:
    values, valid = columns[path]
    if not valid[row]:
        raise PayloadError("no such field", where=path)
    return values[row]
