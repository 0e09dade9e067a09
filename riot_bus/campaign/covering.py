"""Covering of variations: each is tried once, many in one trial as long as trials pass (adaptive group testing).

Variations that are tried together affect different messages. Those that passed are varied further if a trial has room,
and when all were tried. While trials pass, the next one has twice as many variations; after a failure it has half as
many, and the delivered variations are tried again in two halves, until it is known which one fails alone and that the
others do not; if the unit has ended, what came last is one half, as long as that mostly is the cause. Variations that a
trial did not reach, since it failed before, or that changed no message, wait for another trial. So a robust unit is
covered in a few trials, and a fault costs about twice the logarithm of the group's size. Malformed payloads come last:
most units fail on them.
"""

from __future__ import annotations

import random
from bisect import bisect_left
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from riot_bus.campaign.stretches import ENOUGH, Stretches
from riot_bus.campaign.variations import Placed, Variation, sets_value
from riot_bus.statistics.rates import Proportion, proportion
from riot_bus.vocabulary.trial import Outcome, Verdict

_LARGEST = 256
"""Most variations in one trial: enough for 10,000 in a minute, and one that fails is found in sixteen trials."""
_PASSES = 0.5
"""Chance at which a trial of variations that have been set apart, since others about the same failed, has enough."""
_MOST_MISSED = 3
"""Trials that do not reach a variation before it counts as not tried."""
_SHARE_SILENT = 0.25
_SEVERAL = 0.06
"""Share of further variations that occur several times in a trial, half of them on whole messages; it is small since
bursts make trials longer."""
_TIMES = (2, 3, 4)
_ALIKE, _TWO, _ROW = 0.25, 0.5, 0.25
"""Of the rest, shares of two fields in one message (with the same value, which few pairs have, or any) and of
consecutive messages; the others are only moved elsewhere."""
_ELSEWHERE = 0.75
"""Share of the values of an array's elements that are tried in another element, where most have not been yet."""
_IN_A_ROW = 3
_TRIES = 8
_MISSES = 32
"""Number of variations without a free message after which a trial counts as full."""

_Taken = dict[str, list[tuple[int, int]]]


class Covering:
    """Choice of the variations to try next, from outcomes so far; equal outcomes in equal order give equal choices.

    Args:
        positions: For each topic the positions of its messages in the log, ascending.

    Attributes:
        stretches: Choice of policies on many messages, from variations that passed on single ones.
        tried: Variations that were delivered in a conclusive trial, and whether they failed alone.
        nominal_outputs: Number of outputs of a nominal trial: a group after which many are missing is tried in parts.
    """

    def __init__(self, items: Iterable[Variation], positions: Mapping[str, Sequence[int]], *, seed: int) -> None:
        self._random = random.Random(f"covering:{seed}")  # noqa: S311
        self._positions = positions
        self.stretches = Stretches(positions, seed=seed)
        fitting = [item for item in items if item.span <= len(positions.get(item.topic, ()))]
        self._random.shuffle(fitting)
        # faults of whole messages first: they are few, and many values may wait for the only message of a topic
        fitting.sort(key=lambda item: item.injections[0].field is not None)
        self._fresh = deque(item for item in fitting if not item.malformed)
        self._malformed = deque(item for item in fitting if item.malformed)
        self._alone: deque[Variation] = deque()
        self._late = False  # whether what was set apart is being tried
        self._halves: deque[tuple[Placed, ...]] = deque()
        self._hanging: deque[tuple[Placed, ...]] = deque()
        self._hung: set[str] = set()
        self._missed: Counter[int] = Counter()
        self._blamed: dict[int, Placed] = {}  # tried alone as they came last before an end
        self._right = 0  # how much more often they were the cause than not
        self._open = 0  # groups of plausible variations without an outcome yet
        self._unchecked = 1  # how many malformed payloads the next trial has
        self._counts: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
        self._size = 1
        self.total = len(fitting)
        self.nominal_outputs = 0
        self.tried: list[tuple[Variation, bool]] = []
        self._free: dict[str, list[Variation]] = {}
        self._faults: dict[str, list[Variation]] = {}
        self._values: dict[object, list[Variation]] = {}
        self._failed: Counter[object] = Counter()

    def next(self, *, calm: bool = False) -> tuple[Placed, ...]:
        """Return the next variations to try together; nothing when all have been tried or handed out."""
        if self._halves:
            self._open += 1
            return self._halves.pop()  # the latest: what fails alone is then left out of the others
        if self._hanging and not calm:
            self._open += 1
            return self._hanging.popleft()
        if not (self._fresh or self._alone or self._hanging):
            return self.malformed()
        fresh, alone = self._fresh, self._alone
        if calm:
            self._fresh = deque(item for item in fresh if item.about not in self._hung)
            self._alone = deque(item for item in alone if item.about not in self._hung)
        if not self._fresh and self._alone:
            self._late = True
            self._alone = deque(sorted(self._alone, key=lambda item: (item.malformed, self._failing(item))))
            passes = 1.0
            while self._alone and passes > _PASSES:
                passes *= 1 - self._failing(self._alone[0])
                self._fresh.append(self._alone.popleft())
            self._size = len(self._fresh)
        found = self._gather(self._fresh, fill=not self._late) if self._fresh else ()
        self._open += bool(found)
        if calm:
            self._fresh += (item for item in fresh if item.about in self._hung)
            self._alone += (item for item in alone if item.about in self._hung)
        return found

    def malformed(self) -> tuple[Placed, ...]:
        """Return malformed payloads to try next; nothing as long as plausible variations may still pass."""
        plausible = not self._late and bool(self._fresh or self._open)
        if plausible or not self._malformed:
            return ()
        size, self._size = self._size, self._unchecked
        found = self._gather(self._malformed, fill=False)
        self._size = size
        return found

    def further(self) -> tuple[Placed, ...]:
        """Return further variations to try, without end: those that passed, elsewhere, in a row, or two at once."""
        return self._gather(deque(), fill=True)

    def record(self, group: Sequence[Placed], outcome: Outcome) -> None:
        """Record the outcome of a trial of a group that `next`, `further` or `policies` gave."""
        malformed = any(placed.item.malformed for placed in group)
        self._open -= not malformed and self._open > 0
        reached = self._reached(group, outcome)
        failed = outcome.verdict is Verdict.FAIL
        hung = is_hang(outcome)
        missing = self.nominal_outputs - int(outcome.statistics.get("outputs", self.nominal_outputs))
        hidden = len(group) > 1 and missing > len(group) + _SHARE_SILENT * self.nominal_outputs
        apart = failed or hidden or not outcome.judged
        at = {id(placed) for placed in reached}
        hidden_by_others = len(group) > 1 and ended(outcome)
        self._put_back((placed.item for placed in group if id(placed) not in at), missed=not hidden_by_others)
        if len(group) == 1 and self._blamed.pop(id(group[0]), None) is not None:
            self._right += 1 if failed else -1
        if apart and len(reached) > 1:
            blame = ended(outcome) and self._right >= 0
            split = len(reached) - 1 if blame else len(reached) // 2
            halves = self._hanging if hung else self._halves
            halves += (tuple(reached[:split]), tuple(reached[split:]))
            if blame:
                self._blamed[id(reached[-1])] = reached[-1]
        elif outcome.judged:
            fresh = [placed.item for placed in reached if not placed.item.again]
            self.tried += [(item, failed) for item in fresh]
            for item in fresh:
                self._counts[item.about][failed] += 1
            if failed and reached:
                self._failed.update((reached[0].item.injections, reached[0].item.about))
                self._set_apart(reached[0].item.about)
                self._hung |= {reached[0].item.about} if hung else set()
            elif not failed:
                self._remember(fresh)
        if malformed:
            self._unchecked = 1 if apart else min(_LARGEST, len(group) * 2)
        else:
            self._size = max(1, self._size // 2) if apart else min(_LARGEST, max(self._size, len(group)) * 2)

    @property
    def covered(self) -> int:
        """Number of variations that have been tried."""
        return len(self.tried)

    @property
    def undecided(self) -> list[Variation]:
        """Variations of failed trials that have not been told apart yet."""
        return [placed.item for group in (*self._halves, *self._hanging) for placed in group]

    @property
    def finished(self) -> bool:
        """Whether all variations have been tried or handed out, and those that fail are known."""
        return not (self._fresh or self._alone or self._malformed or self._halves or self._hanging)

    def policies(self) -> tuple[Placed, ...]:
        """Return policies on many messages, for topics with everything tried once; nothing if there is none."""
        unfinished = {item.topic for item in self._fresh}
        return self.stretches.next([topic for topic in self._free if topic not in unfinished])

    def _vary(self) -> Variation | None:
        """Return a variation of something that has not failed alone; None if this choice gave none."""
        one = self._random.choice(self._free[self._random.choice(list(self._free))])
        if one.elements and self._random.random() < _ELSEWHERE:
            (injection,) = one.injections
            one = replace(one, injections=(replace(injection, field=self._random.choice(one.elements)),))
        varied = replace(one, again=True)
        if self._random.random() < _SEVERAL:
            if self._faults and self._random.random() < 0.5:
                varied = replace(self._random.choice(self._faults[self._random.choice(list(self._faults))]), again=True)
            known = self._failed[varied.injections] or self._failed[varied.about] >= ENOUGH
            return None if known else replace(varied, times=self._random.choice(_TIMES))
        way = self._random.random()
        if way < _TWO:
            alike = (one.topic, repr(one.injections[0].value)) if way < _ALIKE else one.topic
            other = self._random.choice(self._values.get(alike, [one]) if sets_value(one) else [one])
            if other.about == one.about or other.injections in self._failed:
                return None
            varied = varied.with_(other)
        elif way < _TWO + _ROW and len(self._positions[one.topic]) >= _IN_A_ROW:
            varied = replace(varied, span=_IN_A_ROW)
        known = self._failed[one.injections] or (varied.about != one.about and self._failed[varied.about] >= ENOUGH)
        return None if known else varied

    def _gather(self, queue: deque[Variation], *, fill: bool) -> tuple[Placed, ...]:
        """Return as many variations as a trial should have, each on messages that no other one takes.

        If too few variations of the queue find free messages, further ones may fill the rest.
        """
        taken: _Taken = {}
        found: list[Placed] = []
        passed_over: list[Variation] = []
        while queue and len(found) < self._size and len(passed_over) < _LARGEST:
            item = queue.popleft()
            if one := self._place(item, taken):
                found.append(one)
            else:
                passed_over.append(item)
        queue.extend(passed_over)
        misses = 0
        while fill and self._free and len(found) < self._size and misses < _MISSES:
            if (varied := self._vary()) and (one := self._place(varied, taken)):
                found.append(one)
            else:
                misses += 1
        return tuple(sorted(found, key=self._position))

    def _place(self, item: Variation, taken: _Taken) -> Placed | None:
        """Return a variation on free messages, and mark these as taken; None if too few are free.

        `taken` are the spans of taken message numbers by topic, ascending.
        """
        count, spans = len(self._positions[item.topic]), taken.setdefault(item.topic, [])
        found: list[int] = []
        for first in self._firsts(item, count - item.span) if item.first is None else [item.first]:
            span = (first, first + item.span)
            at = bisect_left(spans, span)
            if not item.fits(first, count):
                continue
            if (at == 0 or spans[at - 1][1] <= first) and (at == len(spans) or spans[at][0] >= span[1]):
                spans.insert(at, span)
                found.append(first)
                if len(found) == item.times:
                    return Placed(item, tuple(sorted(found)))
        for first in found:
            spans.remove((first, first + item.span))
        return None

    def _firsts(self, item: Variation, last: int) -> Iterator[int]:
        """Yield message numbers to try, each for the first message of an occurrence."""
        numbers = item.moves.numbers if item.moves and item.span == 1 else range(last + 1)
        yield from (self._random.choice(numbers) for _ in range(_TRIES * item.times))

    def _reached(self, group: Sequence[Placed], outcome: Outcome) -> list[Placed]:
        """Return the variations that changed a message: its field may be missing, or have that value already.

        If the outcome has no such counts, return all variations whose messages were among those played.
        """
        counts = outcome.statistics.get("delivered")
        if counts is None:
            played = int(outcome.statistics.get("played", 0)) or 1 << 62
            return [placed for placed in group if self._position(placed) < played]
        left = iter(counts)
        return [placed for placed in group if sum(next(left) for _ in placed.injections)]

    def _position(self, placed: Placed) -> int:
        return self._positions[placed.item.topic][placed.firsts[0]]

    def _put_back(self, items: Iterable[Variation], *, missed: bool) -> None:
        for item in items:
            self._missed[id(item)] += missed
            if not item.again and self._missed[id(item)] < _MOST_MISSED:
                self._fresh.append(item)

    def _remember(self, passed: Iterable[Variation]) -> None:
        """Keep the variations that are worth varying further."""
        for item in passed:
            single = item.span == 1 and item.first is None
            if single and not item.malformed and all(each.topic == item.topic for each in item.injections):
                self._free.setdefault(item.topic, []).append(item)
                self.stretches.add(item)
                if item.injections[0].field is None:
                    self._faults.setdefault(item.topic, []).append(item)
                if sets_value(item):
                    for key in (item.topic, (item.topic, repr(item.injections[0].value))):
                        self._values.setdefault(key, []).append(item)

    def _failing(self, item: Variation) -> float:
        """Return the share of the variations about the same thing that have failed alone."""
        passed, failed = self._counts[item.about]
        return (failed + 1) / (passed + failed + 2)

    def _set_apart(self, about: str) -> None:
        """Postpone the other variations about what failed, to be tried alone: most would make their groups fail."""
        for queue in (self._fresh, self._malformed):
            for _ in range(len(queue)):
                item = queue.popleft()
                (self._alone if item.about == about else queue).append(item)
        for parts in (self._halves, self._hanging):
            for _ in range(len(parts)):
                part = parts.popleft()
                self._alone += [each.item for each in part if each.item.about == about and not each.item.again]
                if rest := tuple(each for each in part if each.item.about != about):
                    parts.append(rest)


def ended(outcome: Outcome) -> bool:
    """Return whether the unit came to an end in a trial, so that what came last before that may be the cause."""
    return any(each.monitor in ("crash", "exit") for each in outcome.violations)


def is_hang(outcome: Outcome) -> bool:
    """Return whether the unit hung in a trial."""
    return any(each.monitor == "hang" for each in outcome.violations)


def failure_rates(tried: Iterable[tuple[Variation, bool]], name: Callable[[Variation], str]) -> dict[str, Proportion]:
    """Return the share of tried variations that failed alone, by the name that `name` gives them."""
    failed: dict[str, list[bool]] = {}
    for item, each in tried:
        failed.setdefault(name(item), []).append(each)
    return {key: proportion(sum(each), len(each)) for key, each in sorted(failed.items())}
