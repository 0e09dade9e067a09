"""What a campaign tries: injection policies drawn from dictionaries (RIOT II-A; ASTAA's test cases).

"For all messages of type A on channel X between t_i and t_j, set field f to value v." Trial number and seed alone
decide the draw, so campaigns resume and repeat.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError, PayloadError
from riot_bus.inject.brittle import is_brittle
from riot_bus.injection import Injection

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.inject.dictionary import Dictionary
    from riot_bus.message import Message
    from riot_bus.types.registry import TypeRegistry

__all__ = ["Schedule", "Target", "targets_of"]

_SAMPLES = 5
_MAX_FIELDS = 3
_ELEMENTS = 4


@dataclass(frozen=True, slots=True)
class Target:
    """One field that may be injected, and how many messages carry it."""

    topic: str
    path: str
    type: str
    messages: int


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
    by_topic: dict[str, list[Message]] = {}
    for message in messages:
        if message.kind == "put":
            by_topic.setdefault(registry.topic(message.key), []).append(message)
    targets: dict[str, list[Target]] = {}
    for topic, carried in sorted(by_topic.items()):
        fields: dict[str, str] = {}
        for message in carried[:: max(1, len(carried) // _SAMPLES)]:
            kind = registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
            if kind is None:
                continue
            try:
                leaves = kind.leaves(message.payload, elements=_ELEMENTS)
            except PayloadError:
                continue
            for leaf in leaves:
                fields.setdefault(leaf.path, leaf.type)
        chosen = [
            Target(topic, path, type_name, len(carried))
            for path, type_name in fields.items()
            if not path.startswith("len(")
            and not _listed(leave, topic, path)
            and (not is_brittle(path) or _listed(include, topic, path))
        ]
        if chosen:
            targets[topic] = chosen
    return targets


def _listed(patterns: tuple[str, ...], topic: str, path: str) -> bool:
    return any(fnmatchcase(f"{topic}:{path}", pattern) for pattern in patterns)


class Schedule:
    """Draws the injections of trial 0, 1, 2, ...

    Args:
        targets: Fields by topic, from `targets_of`.
        dictionary: Exceptional values.
        seed: Seed of the campaign.

    Raises:
        ConfigError: Nothing can be injected.
    """

    def __init__(self, targets: Mapping[str, Sequence[Target]], dictionary: Dictionary, *, seed: int) -> None:
        usable = {
            topic: [target for target in fields if dictionary.values_for(target.type, f"{topic}:{target.path}")]
            for topic, fields in targets.items()
        }
        self._targets = {topic: fields for topic, fields in usable.items() if fields}
        self._dictionary = dictionary
        self._seed = seed
        if not self._targets:
            raise ConfigError(
                "the log has no field that can be injected",
                hint="are the message types known ([system.types], [system] messages), and not all fields left alone?",
            )

    def injections(self, trial: int) -> tuple[Injection, ...]:
        """Return the injections of one trial: one topic, one to three fields, one stretch of the log."""
        draw = random.Random(f"{self._seed}:{trial}")  # noqa: S311
        topic = draw.choice(sorted(self._targets))
        fields = self._targets[topic]
        chosen = draw.sample(fields, min(len(fields), draw.choice((1, 1, 2, _MAX_FIELDS))))
        carried = chosen[0].messages
        length = max(1, round(carried ** draw.random()))
        first = draw.randrange(carried - length + 1)
        return tuple(
            Injection(
                topic,
                target.path,
                draw.choice(self._dictionary.values_for(target.type, f"{topic}:{target.path}")).value,
                first=first,
                last=first + length - 1,
                seed=self._seed,
            )
            for target in chosen
        )
