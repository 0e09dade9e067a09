"""Inputs of rules at each message of a log: fields of the latest and earlier messages, and the messages' order."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from riot_bus.types.elements import read_field
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.order import Order, order_of

_NAME = re.compile(r"(?P<topic>.+?)(?:\[(?P<place>\d{1,6})\])?:(?P<path>[^:]*)\Z", re.DOTALL)


class FieldPlace(NamedTuple):
    """A field of the latest message of a topic, or of the message `back` places before it."""

    topic: str
    back: int
    path: str


def place_of(name: str, topics: Sequence[str]) -> FieldPlace:
    """Return the field to which a name refers.

    A name is `topic:path`, or `topic[i]:path` if a short log has several messages of the topic. Of n messages of a
    topic, number n - 1 is the latest one, number n - 2 the one before, and so on.

    Raises:
        ConfigError: It is not the name of a field, or the log has no message with this number.
    """
    found = _NAME.fullmatch(name)
    if found is None:
        raise ConfigError(f"{name!r} is not the name of a field", hint="write topic:path, or topic[number]:path")
    topic, count = found["topic"], max(topics.count(found["topic"]), 1)
    back = count - 1 - int(found["place"]) if found["place"] is not None else 0
    if back < 0:
        raise ConfigError(f"{name!r} names a message that is not there", hint=f"there are {count} of {topic}")
    return FieldPlace(topic, back, found["path"])


def in_words(name: str, topics: Sequence[str]) -> str:
    """Return a name in words: `previous /odom:x` for the message before the latest one."""
    if order_of(name) or _NAME.fullmatch(name) is None:
        return name
    topic, back, path = place_of(name, topics)
    return f"{'' if not back else 'previous ' if back == 1 else f'{back} before the latest '}{topic}:{path}"


class LatestFields:
    """Takes messages in turn and returns the current values of named fields, from the latest messages of their topics.

    The value of an order is returned at each message of its second topic. If it `keeps` values, a message without a
    field leaves its earlier values in force, as if it had not come.

    Raises:
        ConfigError: A name is invalid, or has a number for which the log has no message.
    """

    def __init__(
        self, names: Iterable[str], topics: Sequence[str], *, registry: TypeRegistry, keeps: bool = False
    ) -> None:
        self._registry, self._keeps = registry, keeps
        self._places: dict[str, FieldPlace] = {}
        self._orders: dict[str, Order] = {}
        self._count: Counter[str] = Counter()
        for name in names:
            order = order_of(name)
            if order is not None:
                self._orders[name] = order
                continue
            self._places[name] = place_of(name, topics)
        # of each topic and path the latest values; None where a message does not have it
        self._seen: dict[str, dict[str, deque[Scalar | None]]] = {
            topic: {} for order in self._orders.values() for topic in (order.first, order.second)
        }
        back: Counter[tuple[str, str]] = Counter()
        for place in self._places.values():
            back[place.topic, place.path] = max(place.back, back[place.topic, place.path])
        for (topic, path), most in back.items():
            self._seen.setdefault(topic, {})[path] = deque(maxlen=1 + most)

    def take(self, message: Message) -> Mapping[str, Scalar] | None:
        """Return the value of each field that can be read after this message; None if its topic is not a wanted one.

        A field is missing until enough messages of its topic were taken, and if its message does not have it, unless
        the earlier value is kept.
        """
        topic = self._registry.topic(message.key)
        if topic not in self._seen or message.kind == "delete":
            return None
        for path, seen in self._seen[topic].items():
            value = self._read(message, path)
            if value is not None or not self._keeps:
                seen.append(value)
        values: dict[str, Scalar] = {}
        for name, place in self._places.items():
            seen = self._seen[place.topic][place.path]
            value = seen[-1 - place.back] if place.back < len(seen) else None
            if value is not None:
                values[name] = value
        for name, order in self._orders.items():
            if order.second == topic:
                values[name] = self._count[order.first] > 0 and not (order.once and self._count[topic])
        self._count[topic] += 1
        return values

    def _read(self, message: Message, path: str) -> Scalar | None:
        kind = self._registry.type_of_message(message)
        try:
            return None if kind is None else read_field(kind, message.payload, path)
        except PayloadError:
            return None
