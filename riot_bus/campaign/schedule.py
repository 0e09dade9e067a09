"""Schedule of a campaign: injection policies drawn from dictionaries (RIOT II-A; ASTAA's test cases).

"For all messages of type A on channel X between t_i and t_j, set field f to value v." Trial number and seed alone
decide the draw, so campaigns resume and repeat.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from riot_bus.campaign.targets import MOST_ADDED_BYTES, Target, any_names
from riot_bus.campaign.variations import Variation, moves_of
from riot_bus.types.model import family_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.campaign.groups import Group
    from riot_bus.inject.dictionary import Dictionary
    from riot_bus.types.capabilities import SuggestedValue
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_GROUPED = 0.3
"""Share of the policies that are mutations, on topics that have some."""
_SOME, _BURST = 0.25, 20
"""Share of a topic's messages that is missing at the start; number of copies in a burst."""


class Schedule:
    """Random choice of the injections of trial 0, 1, 2, ...

    Args:
        targets: Fields by topic, from `targets_of`; all elements of an array together weigh as much as one field.
        groups: Mutations by topic and family, from `groups_of`; each family has the same weight.

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
        self._dictionary = dictionary
        # by topic and path
        self.types = {(topic, each.path): each.type for topic, fields in targets.items() for each in fields}
        self._families: dict[str, dict[str, list[Target]]] = {}
        for topic, fields in targets.items():
            for target in fields:
                if self._values(target):
                    family = family_of(target.path)
                    self._families.setdefault(topic, {}).setdefault(family, []).append(target)
        self._groups = groups or {}
        self._topics = sorted({*self._families, *self._groups})
        self._seed = seed
        if not self._topics:
            raise ConfigError(
                "the log has no field that can be injected",
                hint="are the message types known ([system.types], [system] messages), and not all fields left alone?",
            )

    def injections(self, trial: int) -> tuple[Injection, ...]:
        """Return the injections of one trial: a few policies, each on one topic, some fields, a stretch of the log.

        Several policies find more per trial; minimisation later shows which of them mattered.
        """
        draw = random.Random(f"{self._seed}:{trial}")  # noqa: S311
        return tuple(injection for _ in range(draw.choice((1, 2, 3))) for injection in self._policy(draw))

    def items(self) -> list[Variation]:
        """Return each value of each field, and each mutation, as variations to try once.

        In an array, each value is tried in one element.
        """
        draw = random.Random(f"elements:{self._seed}")  # noqa: S311
        found = []
        for topic, families in self._families.items():
            for family, targets in families.items():
                known = [self._values(target) for target in targets]
                common = set.intersection(*({repr(each.value) for each in values} for values in known))
                alike = len({target.type for target in targets}) == 1
                for number in range(max(map(len, known))):
                    at = number % len(targets)
                    if number < len(known[at]):
                        value = known[at][number].value
                        most = MOST_ADDED_BYTES // max(1, len(value)) if isinstance(value, str | bytes) else None
                        elements = targets[at].elements if alike and repr(value) in common else ()
                        path = draw.choice(elements) if elements else targets[at].path
                        injection = Injection(topic, path, value, seed=self._seed)
                        about = f"{topic}:{family}"
                        found.append(Variation(topic, (injection,), about, most=most, elements=elements))
        for topic, groups in self._groups.items():
            for family, group in groups.items():
                found += [
                    Variation(topic, tuple(each.injections(0, 0, seed=self._seed)), f"{topic} {family}", most=each.most)
                    for each in group
                ]
        return found

    def _values(self, target: Target) -> Sequence[SuggestedValue]:
        return self._dictionary.values_for(target.type, f"{target.topic}:{target.path}", told=target.told)

    def _policy(self, draw: random.Random) -> list[Injection]:
        topic = draw.choice(self._topics)
        groups, families = self._groups.get(topic, {}), self._families.get(topic, {})
        if groups and (not families or draw.random() < _GROUPED):
            group = draw.choice(groups[draw.choice(sorted(groups))])
            first, last = _stretch(draw, group.messages, group.most)
            return group.injections(first, last, seed=self._seed)
        names = draw.sample(sorted(families), min(len(families), draw.choice((1, 1, 2, 3))))
        chosen = [draw.choice(families[name]) for name in names]
        first, last = _stretch(draw, chosen[0].messages)
        return [
            Injection(
                topic, target.path, draw.choice(self._values(target)).value, first=first, last=last, seed=self._seed
            )
            for target in chosen
        ]


def _stretch(draw: random.Random, messages: int, most: int | None = None) -> tuple[int, int]:
    """Return the first and the last of some messages in a row, `most` of them at most."""
    length = max(1, round(messages ** draw.random()))
    length = length if most is None else min(length, most)
    first = draw.randrange(messages - length + 1)
    return first, first + length - 1


def message_faults(
    messages: Sequence[Message], registry: TypeRegistry, *, leave: Sequence[str] = ()
) -> list[Variation]:
    """Return faults of whole messages of a log, as variations to try once on each topic.

    Single messages and a few in a row are dropped, those at the start are missing; a message comes twice, or in a
    burst, or later or earlier (`moves_of`).

    Topics none of whose fields may be changed, as of `leave`, are left alone.
    """
    found = []
    times, places = [message.time for message in messages], positions_of(messages, registry)
    still = {topic for topic in places if any_names(leave, topic, "")}
    for topic, positions in places.items():
        if topic in still:
            continue
        some = max(1, round(_SOME * len(positions)))
        found += [
            Variation(topic, (Injection(topic, fault="drop"),), f"{topic} drop", span, first)
            for span, first in ((1, None), (3, None), (some, 0), (1, 0))
        ]
        found += [
            Variation(topic, (Injection(topic, fault="duplicate", copies=copies),), f"{topic} duplicate")
            for copies in (1, _BURST)
        ]
        for moves in moves_of(topic, times, places, still=still):
            usual = moves.injections(moves.numbers[len(moves.numbers) // 2])
            found.append(Variation(topic, usual, f"{topic} {'early' if moves.way < 0 else 'delay'}", moves=moves))
    return found


def positions_of(messages: Sequence[Message], registry: TypeRegistry) -> dict[str, list[int]]:
    """Return for each topic the positions of its messages in a log."""
    found: dict[str, list[int]] = {}
    for position, message in enumerate(messages):
        found.setdefault(registry.topic(message.key), []).append(position)
    return found
