"""Fields of the latest messages of several topics, by the names that rules have for them."""

from __future__ import annotations

import re
from collections import deque
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, PayloadError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["LatestFields"]

_NAME = re.compile(r"(?P<topic>.+?)(?:\[(?P<place>\d{1,6})\])?:(?P<path>[^:]*)\Z", re.DOTALL)


class LatestFields:
    """Takes messages in turn and tells what named fields are at that moment, each by the latest messages of its topic.

    A name is `topic:path`, or `topic[i]:path` where a short log holds several messages of the topic. Of such a log's n
    messages of a topic, number n - 1 is the latest one, number n - 2 the one before, and so on.

    Args:
        names: The fields.
        topics: Topic of each message of the short log in which the fields are named; for those without a number in
            their name it may lack.
        registry: Names topics and knows types.

    Raises:
        ConfigError: A name is none, or has a number that the log has no message for.
    """

    def __init__(self, names: Iterable[str], topics: Sequence[str], *, registry: TypeRegistry) -> None:
        self._registry = registry
        self._wanted: dict[str, list[tuple[str, int, str]]] = {}
        self._seen: dict[str, deque[Message]] = {}
        for name in names:
            found = _NAME.fullmatch(name)
            if found is None:
                raise ConfigError(f"{name!r} is no field: fields are called topic:path")
            topic, count = found["topic"], max(topics.count(found["topic"]), 1)
            back = count - 1 - int(found["place"]) if found["place"] is not None else 0
            if back < 0:
                raise ConfigError(f"{name!r} names a message that is not there", hint=f"there are {count} of {topic}")
            self._wanted.setdefault(topic, []).append((name, back, found["path"]))
        for topic, wanted in self._wanted.items():
            self._seen[topic] = deque(maxlen=1 + max(back for _, back, _ in wanted))

    def take(self, message: Message) -> Mapping[str, Scalar] | None:
        """Return the value of each field that can be read after this message; None if it is of none of the topics.

        A field is not among them before enough messages of its topic came, or where its message does not have it.
        """
        topic = self._registry.topic(message.key)
        if topic not in self._seen or message.kind == "delete":
            return None
        self._seen[topic].append(message)
        values: dict[str, Scalar] = {}
        for each, wanted in self._wanted.items():
            for name, back, path in wanted:
                if back < len(self._seen[each]):
                    self._read(self._seen[each][-1 - back], name, path, values)
        return values

    def _read(self, message: Message, name: str, path: str, values: dict[str, Scalar]) -> None:
        kind = self._registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
        try:
            if kind is not None:
                values[name] = kind.read(message.payload, path)
        except PayloadError:
            return
