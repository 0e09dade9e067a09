"""What a campaign tries: injection policies drawn from dictionaries (RIOT II-A; ASTAA's test cases).

"For all messages of type A on channel X between t_i and t_j, set field f to value v." Trial number and seed alone
decide the draw, so campaigns resume and repeat.
"""

from __future__ import annotations

import random
import re
from typing import TYPE_CHECKING

from riot_bus.campaign.targets import Target, targets_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.campaign.groups import Group
    from riot_bus.inject.dictionary import Dictionary

__all__ = ["Schedule", "Target", "targets_of"]

_POLICIES = (1, 2, 3)
_FIELDS = (1, 1, 2, 3)
_GROUPED = 0.3
"""Share of the policies that are mutations, on topics that have some."""
_INDEX = re.compile(r"\[\d+\]")


class Schedule:
    """Draws the injections of trial 0, 1, 2, ...

    Args:
        targets: Fields by topic, from `targets_of`; the elements of an array weigh as much as one field together.
        dictionary: Exceptional values.
        seed: Seed of the campaign.
        groups: Mutations by topic and family, from `groups_of`; all of a family weigh as much as another one's.

    Raises:
        ConfigError: Nothing can be injected.
    """

    def __init__(
        self,
        targets: Mapping[str, Sequence[Target]],
        dictionary: Dictionary,
        *,
        seed: int,
        groups: Mapping[str, Mapping[str, Sequence[Group]]] | None = None,
    ) -> None:
        self._families: dict[str, dict[str, list[Target]]] = {}
        for topic, fields in targets.items():
            for target in fields:
                if dictionary.values_for(target.type, f"{topic}:{target.path}", told=target.told):
                    family = _INDEX.sub("[*]", target.path)
                    self._families.setdefault(topic, {}).setdefault(family, []).append(target)
        self._groups = groups or {}
        self._topics = sorted({*self._families, *self._groups})
        self._dictionary = dictionary
        self._seed = seed
        if not self._topics:
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
        topic = draw.choice(self._topics)
        groups, families = self._groups.get(topic, {}), self._families.get(topic, {})
        if groups and (not families or draw.random() < _GROUPED):
            group = draw.choice(groups[draw.choice(sorted(groups))])
            first, last = _stretch(draw, group.messages, group.most)
            return group.injections(first, last, seed=self._seed)
        names = draw.sample(sorted(families), min(len(families), draw.choice(_FIELDS)))
        chosen = [draw.choice(families[name]) for name in names]
        values = self._dictionary.values_for
        first, last = _stretch(draw, chosen[0].messages)
        return [
            Injection(
                topic,
                target.path,
                draw.choice(values(target.type, f"{topic}:{target.path}", told=target.told)).value,
                first=first,
                last=last,
                seed=self._seed,
            )
            for target in chosen
        ]


def _stretch(draw: random.Random, messages: int, most: int | None = None) -> tuple[int, int]:
    """Return the first and the last of some messages in a row, `most` of them at most."""
    length = max(1, round(messages ** draw.random()))
    length = length if most is None else min(length, most)
    first = draw.randrange(messages - length + 1)
    return first, first + length - 1
