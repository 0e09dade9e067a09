"""What a campaign tries: injection policies drawn from dictionaries (RIOT II-A; ASTAA's test cases).

"For all messages of type A on channel X between t_i and t_j, set field f to value v." Trial number and seed alone
decide the draw, so campaigns resume and repeat.
"""

from __future__ import annotations

import random
import re
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
_POLICIES = (1, 2, 3)
_FIELDS = (1, 1, 2, 3)
_ELEMENTS = 4
_INDEX = re.compile(r"\[\d+\]")


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
        targets: Fields by topic, from `targets_of`; the elements of an array weigh as much as one field together.
        dictionary: Exceptional values.
        seed: Seed of the campaign.

    Raises:
        ConfigError: Nothing can be injected.
    """

    def __init__(self, targets: Mapping[str, Sequence[Target]], dictionary: Dictionary, *, seed: int) -> None:
        self._families: dict[str, dict[str, list[Target]]] = {}
        for topic, fields in targets.items():
            for target in fields:
                if dictionary.values_for(target.type, f"{topic}:{target.path}"):
                    family = _INDEX.sub("[*]", target.path)
                    self._families.setdefault(topic, {}).setdefault(family, []).append(target)
        self._dictionary = dictionary
        self._seed = seed
        if not self._families:
            raise ConfigError(
                "the log has no field that can be injected",
                hint="are the message types known ([system.types], [system] messages), and not all fields left alone?",
            )

    def injections(self, trial: int) -> tuple[Injection, ...]:
        """Return the injections of one trial: a few policies, each on one topic, some fields, a stretch of the log.

        Several policies per trial find more per trial; minimisation tells later which of them mattered.
        """
        draw = random.Random(f"{self._seed}:{trial}")  # noqa: S311
        policies = draw.choice(_POLICIES)
        return tuple(injection for _ in range(policies) for injection in self._policy(draw))

    def _policy(self, draw: random.Random) -> list[Injection]:
        families = self._families[draw.choice(sorted(self._families))]
        names = draw.sample(sorted(families), min(len(families), draw.choice(_FIELDS)))
        chosen = [draw.choice(families[name]) for name in names]
        carried = chosen[0].messages
        length = max(1, round(carried ** draw.random()))
        first = draw.randrange(carried - length + 1)
        return [
            Injection(
                target.topic,
                target.path,
                draw.choice(self._dictionary.values_for(target.type, f"{target.topic}:{target.path}")).value,
                first=first,
                last=first + length - 1,
                seed=self._seed,
            )
            for target in chosen
        ]
