"""Yields messages of files without keys, such as ROS 2 bags, as they would arrive from the bus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.types.capabilities import Identity, Offer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from riot_bus.log.reader import LogReader
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_NOBODY = "0"  # a session's id


def bus_messages(
    reader: LogReader, registry: TypeRegistry, *, start: int | None = None, end: int | None = None
) -> Iterator[Message]:
    """Yield the delivered messages; those of a file without keys under the keys that they would have on the bus.

    Each of the latter gets a number, and the attachment that its middleware needs, from an otherwise unknown publisher.

    Raises:
        ConfigError: A topic cannot be published.
    """
    foreign: dict[str, _Topic] = {}
    for number, topic in enumerate(reader.recorded_topics(), 1):
        if not topic.keyed:
            found = (each.offer(topic, name=None, domain=None) for each in registry.publishing_adapters())
            offer = next((each for each in found if each is not None), Offer(topic.key.strip("/")))
            identity = offer.identify(_NOBODY, number) if offer.identify is not None else Identity()
            foreign[topic.key] = _Topic(offer.key, identity.attachment)
    if not foreign:
        yield from reader.messages(start=start, end=end)
        return
    for number, message in enumerate(reader.messages(start=start, end=end)):
        known = foreign.get(message.key)
        yield message if known is None else known.on_bus(message, number)


class _Topic:
    def __init__(self, key: str, attachment: Callable[[bytes | None, int, int], bytes | None] | None) -> None:
        self._key, self._attachment = key, attachment
        self._count = 0

    def on_bus(self, message: Message, number: int) -> Message:
        self._count += 1
        attachment = message.attachment
        if self._attachment is not None:
            published = message.time if message.publish_time is None else message.publish_time
            attachment = self._attachment(attachment, self._count, published)
        return message.with_(key=self._key, attachment=attachment, sequence=number)


def learn_types(reader: LogReader, registry: TypeRegistry) -> None:
    """Add to a registry the types that a log's schemas describe, of topics whose type it does not know yet."""
    for topic, (schema, encoding) in reader.schemas.items():
        if registry.type_of(topic) is None:
            registry.add_schema(topic, schema, encoding)
