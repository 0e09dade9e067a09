"""What of a log may be changed: its fields, less those that are better left alone or that the user excludes."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from riot_bus.inject.brittle import why_brittle
from riot_bus.types.capabilities import suggested_values
from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.types.capabilities import SuggestedValue
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

__all__ = ["Target", "may_change", "samples_by_topic", "targets_of"]

_SAMPLES = 5
_ELEMENTS = 4


@dataclass(frozen=True, slots=True)
class Target:
    """One field that may be injected, and how many messages carry it.

    Attributes:
        told: Values that its definition tells.
    """

    topic: str
    path: str
    type: str
    messages: int
    told: tuple[SuggestedValue, ...] = ()


def targets_of(
    messages: Sequence[Message],
    registry: TypeRegistry,
    *,
    leave: Iterable[str] = (),
    include: Iterable[str] = (),
) -> dict[str, list[Target]]:
    """List the fields of a log that injections may change, by topic.

    Args:
        messages: The nominal log.
        registry: Knows the types.
        leave: Patterns (`topic:path`, with `*`) of fields to leave alone.
        include: Patterns of brittle fields (stamps, sequence numbers, frame ids) that are asked for all the same.
    """
    leave, include = tuple(leave), tuple(include)
    targets: dict[str, list[Target]] = {}
    for topic, (count, samples) in samples_by_topic(messages, registry).items():
        fields: dict[str, str] = {}
        told: dict[str, dict[object, SuggestedValue]] = {}
        kinds: dict[str, MessageType] = {}
        for kind, payload in samples:
            try:
                leaves = kind.leaves(payload, elements=_ELEMENTS)
            except PayloadError:
                continue
            for leaf in leaves:
                fields.setdefault(leaf.path, leaf.type)
                kinds.setdefault(leaf.path, kind)
                for entry in suggested_values(kind, payload, leaf.path):
                    told.setdefault(leaf.path, {}).setdefault(repr(entry.value), entry)
        chosen = [
            Target(topic, path, type_name, count, tuple(told.get(path, {}).values()))
            for path, type_name in fields.items()
            if not path.startswith("len(") and may_change(topic, path, leave, include, kind=kinds[path])
        ]
        if chosen:
            targets[topic] = chosen
    return targets


def samples_by_topic(
    messages: Sequence[Message], registry: TypeRegistry, *, most: int = _SAMPLES
) -> dict[str, tuple[int, list[tuple[MessageType, bytes]]]]:
    """Return for each topic, sorted, how many messages it has, and types and payloads of about `most` of them."""
    by_topic: dict[str, list[Message]] = {}
    for message in messages:
        if message.kind == "put":
            by_topic.setdefault(registry.topic(message.key), []).append(message)
    found = {}
    for topic, carried in sorted(by_topic.items()):
        samples = []
        for message in carried[:: max(1, len(carried) // most)]:
            kind = registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
            if kind is not None:
                samples.append((kind, message.payload))
        found[topic] = (len(carried), samples)
    return found


def may_change(
    topic: str,
    path: str,
    leave: tuple[str, ...],
    include: tuple[str, ...],
    *,
    kind: MessageType | None = None,
    asked: bool = False,
) -> bool:
    """Return whether a field may be injected.

    Args:
        topic: Its topic.
        path: Its path.
        leave: Patterns of fields to leave alone.
        include: Patterns of fields that are asked for.
        kind: Type of its messages.
        asked: Whether it has to be asked for, brittle or not.
    """
    if _listed(leave, topic, path):
        return False
    return _listed(include, topic, path) or not (asked or why_brittle(path, kind))


def _listed(patterns: tuple[str, ...], topic: str, path: str) -> bool:
    names = [path, path[4:-1]] if path.startswith("len(") else [path]  # whoever names an array means its length too
    return any(fnmatchcase(f"{topic}:{name}", pattern) for pattern in patterns for name in names)
