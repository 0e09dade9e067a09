"""Choice of policies on many messages: on all in a row, or on a share of them.

Many messages may cause failures that single ones do not, such as by accumulated state or losses. Variations that are
tried this way have passed on a single message. A trial has one policy for each topic; if it fails, its halves are
tried, until it is known which policy fails alone.
"""

from __future__ import annotations

import math
import random
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

from riot_bus.campaign.variations import Placed, Variation, sets_value
from riot_bus.vocabulary.trial import Outcome, Verdict

_LEAST = 4
"""Fewest messages in a row that are a stretch: `Covering` tries three."""
_FAULTS = 0.2
"""Share of faults of whole messages, of which there are fewer than values."""
_BOTH = 0.25
"""Share of policies that set two fields."""
ENOUGH = 3
"""Variations of one thing that fail alone, after which no more are tried."""
_SHARES = (0.1, 0.3, 0.5)  # a guess: from every tenth message to every second; more is nearly a row
_MISSES = 4  # a guess: what has failed often enough is drawn again, but perhaps all has


class Stretches:
    """Choice of policies on many messages; equal outcomes in equal order give equal choices.

    Args:
        positions: For each topic the positions of its messages in the log, ascending.
    """

    def __init__(self, positions: Mapping[str, Sequence[int]], *, seed: int) -> None:
        self._random = random.Random(f"stretches:{seed}")  # noqa: S311
        self._positions = positions
        self._values: dict[str, dict[str, list[Variation]]] = {}
        self._faults: dict[str, list[Variation]] = {}
        self._halves: deque[tuple[Placed, ...]] = deque()
        self._failed: Counter[str] = Counter()

    def add(self, item: Variation) -> None:
        """Add a variation that has passed on a single message of its topic."""
        if len(self._positions[item.topic]) < _LEAST:
            return
        if item.injections[0].field is None:
            self._faults.setdefault(item.topic, []).append(item)
        else:
            self._values.setdefault(item.topic, {}).setdefault(item.about, []).append(item)

    def next(self, topics: Sequence[str]) -> tuple[Placed, ...]:
        """Return policies to try together, at most one for each of these topics, or none at all."""
        if self._halves:
            return self._halves.popleft()
        known = [topic for topic in topics if topic in self._values or topic in self._faults]
        found = [placed for topic in known if (placed := self._policy(topic)) is not None]
        return tuple(sorted(found, key=lambda placed: self._positions[placed.item.topic][placed.firsts[0]]))

    def record(self, group: Sequence[Placed], outcome: Outcome) -> None:
        """Record the outcome of a trial of a group."""
        if outcome.verdict is Verdict.PASS:
            return
        if len(group) > 1:
            half = len(group) // 2
            self._halves += (tuple(group[:half]), tuple(group[half:]))
        else:
            self._failed[group[0].item.about] += 1

    def _policy(self, topic: str) -> Placed | None:
        for _ in range(_MISSES):
            item = self._item(topic)
            most = len(self._positions[topic])
            most = min(most, item.most or most, most // max(each.copies for each in item.injections))
            if self._failed[item.about] < ENOUGH and most >= _LEAST:
                way = self._random.choice((self._row, self._row, self._share))
                return way(replace(item, again=True, moves=None), most)
        return None

    def _item(self, topic: str) -> Variation:
        """Return a change to the messages; all fields have the same weight, however many values they have."""
        values, faults = self._values.get(topic, {}), self._faults.get(topic, ())
        if faults and (not values or self._random.random() < _FAULTS):
            return self._random.choice(faults)
        one, other = (self._random.choice(values[self._random.choice(list(values))]) for _ in range(2))
        if self._random.random() >= _BOTH or one.about == other.about or not (sets_value(one) and sets_value(other)):
            return one
        return one.with_(other)

    def _row(self, item: Variation, most: int) -> Placed:
        """Return the change on messages in a row: a window of numbers."""
        length = round(math.exp(self._random.uniform(math.log(_LEAST), math.log(most))))
        first = self._random.randint(0, len(self._positions[item.topic]) - length)
        return Placed(replace(item, span=length), (first,))

    def _share(self, item: Variation, most: int) -> Placed:
        """Return the change on a random share of messages in a row."""
        share, seed = self._random.choice(_SHARES), self._random.randrange(1 << 31)
        changes = tuple(replace(each, probability=share, seed=seed) for each in item.injections)
        return self._row(replace(item, injections=changes), most)
