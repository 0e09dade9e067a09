"""Failing logs: the messages as they were delivered, the originals of the modified ones, and their fields by name."""

from __future__ import annotations

import logging
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

from riot_bus.generalize.oracle import same_scalar
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.new_file import whole_file
from riot_bus.types.elements import read_elements
from riot_bus.types.model import Leaf, MessageType
from riot_bus.vocabulary.elements import Elements, Setting
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean
from riot_bus.vocabulary.order import Order, order_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.pipeline.event import Change
    from riot_bus.system.system_file import SystemFile
    from riot_bus.trial.context import Context
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message, Scalar

_ELEMENTS = 4
_CHANGED = 64
"""Elements of each array that are checked for changes; unchanged ones are fields only up to `_ELEMENTS`."""
_INDEX = re.compile(r"\[(\d+)\]")
_LONGEST = (1 << 16) - 1
"""Up to this, lengths of arrays that injections changed are fields, too, with the type of 16-bit numbers."""
_LOG = logging.getLogger(__name__)


def read_messages(path: Path, *, registry: TypeRegistry) -> tuple[Message, ...]:
    """Return the delivered messages of a log, and learn the types that it names; damage is logged as a warning.

    Messages of a ROS 2 bag get the keys and attachments of rmw_zenoh.

    Raises:
        ConfigError: The file is missing or not MCAP.
    """
    with LogReader(path) as reader:
        learn_types(reader, registry)
        messages = tuple(bus_messages(reader, registry))
        if reader.loss:
            _warn(str(path), str(reader.loss))
        return messages


def inputs_of(
    unit: str, messages: Iterable[Message], *, file: SystemFile, registry: TypeRegistry, path: Path
) -> tuple[Message, ...]:
    """Return the messages of a log that are inputs of a unit.

    Raises:
        ConfigError: The log has no input of the unit.
    """
    inputs = file.components[file.component_of(unit)].inputs
    log = list(messages)
    found = tuple(message for message in log if any(registry.matches(topic, message.key) for topic in inputs))
    if not found:
        raise ConfigError(
            f"the log holds nothing on the inputs of {unit!r} ({', '.join(inputs) or 'none declared'})",
            where=str(path),
            hint=did_you_mean(next(iter(inputs), ""), {registry.topic(message.key) for message in log}),
        )
    return found


@cache
def _warn(path: str, loss: str) -> None:
    _LOG.warning("riot: %s is damaged (%s); going on with what can be read", path, loss)


@dataclass(frozen=True, slots=True)
class FailingLog:
    """A log and, by message number, the originals of modified messages."""

    messages: tuple[Message, ...]
    originals: Mapping[int, Message]

    def keep(self, indices: Iterable[int]) -> FailingLog:
        """Return the part of the log with these positions."""
        kept = tuple(self.messages[index] for index in indices)
        numbers = {message.sequence for message in kept}
        return FailingLog(kept, {number: one for number, one in self.originals.items() if number in numbers})

    def followed_by(self, messages: Iterable[Message]) -> FailingLog:
        """Return the log with unmodified messages at its end, which get the next numbers."""
        first = max((message.sequence for message in self.messages), default=-1) + 1
        more = (message.with_(sequence=first + number) for number, message in enumerate(messages))
        return FailingLog((*self.messages, *more), self.originals)

    def names(self, registry: TypeRegistry) -> list[str]:
        """Return the names of messages: `topic`, or `topic[i]` if the log has several of the topic."""
        topics = [registry.topic(message.key) for message in self.messages]
        counts, seen = Counter(topics), Counter[str]()
        names = []
        for topic in topics:
            names.append(f"{topic}[{seen[topic]}]" if counts[topic] > 1 else topic)
            seen[topic] += 1
        return names

    def restored(self) -> FailingLog:
        """Return the log with originals in place of modified messages, each once and in order of their numbers."""
        known = {one.sequence: self.originals.get(one.sequence, one) for one in self.messages}
        return FailingLog(tuple(known[number] for number in sorted(known)), {})

    def save(
        self,
        path: Path,
        *,
        context: Context,
        metadata: Mapping[str, str],
        changes: Mapping[int, Sequence[Change]] | None = None,
    ) -> None:
        """Write the log with its originals and provenance, in one step, so that a reader never sees half of it."""
        with (
            whole_file(path) as temporary,
            LogWriter(temporary, registry=context.registry, profile=context.profile, metadata=metadata) as writer,
        ):
            for message in self.messages:
                original = self.originals.get(message.sequence)
                if original is not None:
                    writer.write(original, role="original", changes=(changes or {}).get(message.sequence, ()))
                writer.write(message)

    @classmethod
    def load(cls, path: Path, *, registry: TypeRegistry) -> FailingLog:
        """Read a log that `save` or a recorder wrote.

        Raises:
            ConfigError: The file is missing or not MCAP.
        """
        with LogReader(path) as reader:
            learn_types(reader, registry)
            messages = tuple(reader.messages())
            originals = {message.sequence: message for message in reader.originals()}
        return cls(messages, originals)


@dataclass(frozen=True, slots=True)
class NamedField:
    """One scalar field of one message of a short log.

    Attributes:
        name: `topic:path`, or `topic[i]:path` if the log has several messages of the topic.
        original: Value before the injection; None if the field was not changed.
    """

    name: str
    topic: str
    position: int
    leaf: Leaf
    original: Scalar | None
    kind: MessageType
    payload: bytes


class NamedFields:
    """The fields of a short log by name, and the log with some of them replaced."""

    def __init__(self, log: FailingLog, *, registry: TypeRegistry) -> None:
        self.log = log
        self.registry = registry
        self.topics = topics = [registry.topic(message.key) for message in log.messages]
        several = {topic for topic, count in Counter(topics).items() if count > 1}
        self.fields: dict[str, NamedField] = {}
        self._positions: dict[str, int] = {}
        for position, (prefix, message) in enumerate(zip(log.names(registry), log.messages, strict=True)):
            topic = topics[position]
            self._positions[prefix] = position
            kind = registry.type_of_message(message)
            if kind is None or message.kind == "delete":
                continue
            for leaf, original in self._leaves(kind, message):
                name = f"{prefix}:{leaf.path}"
                self.fields[name] = NamedField(name, topic, position, leaf, original, kind, message.payload)
        orders = [Order(*pair) for pair in pairwise(topics)]
        self.orders: dict[str, int] = {
            str(order): position
            for position, order in enumerate(orders)
            if not several & {order.first, order.second} and order_of(str(order)) == order
        }
        """Order of two adjacent messages, whose topics occur once each, to the position of the first message."""

    def _leaves(self, kind: MessageType, message: Message) -> Iterable[tuple[Leaf, Scalar | None]]:
        before = self.log.originals.get(message.sequence)
        try:
            leaves = kind.leaves(message.payload, elements=_ELEMENTS if before is None else _CHANGED)
        except PayloadError:
            return
        for leaf in leaves:
            original: Scalar | None = None
            if before is not None:
                with suppress(PayloadError):
                    value = kind.read(before.payload, leaf.path)
                    original = None if same_scalar(value, leaf.value) else value
            if leaf.path.startswith("len("):
                if original is not None and max(int(original), int(leaf.value)) <= _LONGEST:
                    yield Leaf(leaf.path, "uint16", leaf.value), original
            elif original is not None or not any(int(index) >= _ELEMENTS for index in _INDEX.findall(leaf.path)):
                yield leaf, original

    def with_values(self, values: Mapping[str, Setting]) -> tuple[Message, ...]:
        """Return the log's messages with fields set by name; fields that keep their value keep their bytes.

        Args:
            values: Values by name: of fields; of all elements of an array, by a name with `[*]`; for an order, whether
                it is that of the log.

        Raises:
            ConfigError: The log has no such field or array.
        """
        changes: dict[int, dict[str, Scalar]] = {}
        turned: set[int] = set()
        for name, value in values.items():
            order = order_of(name)
            if order is not None and str(order._replace(once=False)) in self.orders:
                turned.update([] if value else [self.orders[str(order._replace(once=False))]])
                continue
            if isinstance(value, Elements):
                position, patch = self._elements(name, value)
                if patch:
                    changes.setdefault(position, {}).update(patch)
                continue
            field = self.fields.get(name)
            if field is None:
                raise ConfigError(f"the minimal log has no field {name!r}")
            if not same_scalar(value, field.leaf.value):
                changes.setdefault(field.position, {})[field.leaf.path] = value
        messages = list(self.log.messages)
        for position, patch in changes.items():
            message = messages[position]
            kind = self.registry.type_of_message(message)
            assert kind is not None
            messages[position] = message.with_(payload=_changed(kind, message.payload, patch))
        return _turned(messages, turned) if turned else tuple(messages)

    def _elements(self, name: str, elements: Elements) -> tuple[int, dict[str, Scalar]]:
        """Return the message of an array, and the elements that change."""
        prefix, _, path = name.rpartition(":")
        position = self._positions.get(prefix)
        if position is None:
            raise ConfigError(f"the minimal log has no array {name!r}")
        message = self.log.messages[position]
        kind = self.registry.type_of_message(message)
        assert kind is not None
        before = read_elements(kind, message.payload, path)
        pairs = enumerate(zip(elements, before, strict=True))
        return position, {path.replace("[*]", f"[{at}]"): new for at, (new, old) in pairs if not same_scalar(new, old)}


def _turned(messages: Sequence[Message], turned: set[int]) -> tuple[Message, ...]:
    """Return messages with the order of some adjacent pairs reversed; a chain of such pairs is reversed as a whole.

    Args:
        turned: Position of the first message of each pair.
    """
    found: list[Message] = []
    run: list[Message] = []
    for place, message in enumerate(messages):
        run.append(message)
        if place not in turned:
            found += reversed(run)
            run = []
    return tuple(one.with_(time=slot.time) for one, slot in zip(found, messages, strict=True))


def internal_name(name: str) -> str:
    """Return the bus-wide name of a field of a minimal log (`topic[2]:path` is `topic:path`)."""
    topic, _, path = name.rpartition(":")
    return re.sub(r"\[\d+\]$", "", topic) + ":" + path


def _changed(kind: MessageType, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
    """Return a payload with fields changed; changes of elements beyond a shortened array are ignored."""
    lengths = {path: value for path, value in changes.items() if path.startswith("len(")}
    if not lengths:
        return kind.rebuild(payload, changes)
    payload = kind.rebuild(payload, lengths)
    for path, value in changes.items():
        if path not in lengths:
            with suppress(PayloadError):
                payload = kind.rebuild(payload, {path: value})
    return payload


def nominal_values(
    messages: Sequence[Message], paths: Mapping[str, Iterable[str]], *, registry: TypeRegistry, at_most: int = 2000
) -> dict[str, list[Scalar]]:
    """Return the values of fields (by topic, then path) in evenly spaced messages of a log."""
    values: dict[str, list[Scalar]] = {f"{topic}:{path}": [] for topic, some in paths.items() for path in some}
    by_topic: dict[str, list[Message]] = {topic: [] for topic in paths}
    for message in messages:
        topic = registry.topic(message.key)
        if topic in by_topic:
            by_topic[topic].append(message)
    for topic, carried in by_topic.items():
        for message in carried[:: max(1, -(-len(carried) // at_most))]:
            kind = registry.type_of_message(message)
            if kind is None:
                break
            for path in paths[topic]:
                try:
                    values[f"{topic}:{path}"].append(kind.read(message.payload, path))
                except PayloadError:
                    continue
    return values
