"""Statistics of nominal trials: what their messages hold, and how far another trial may differ.

Of each field and trial the largest value is taken (of the smallest in the same way). These maxima of N trials have mean
m and standard deviation s. Maxima of many values follow Gumbel's distribution more or less, whatever the values do, so
the next one is above m + k s with probability p for

    k = (-ln p - 0.5772) / 1.2825 * t / z

The quotient of Student's t (N - 1 degrees of freedom) and the normal z, both at p, stands for what N trials do not tell
about m and s. A bound is at least half of the nominal range outside it, and a constant may vary by half its size and by
1 at least: some differences are only seen in more trials than there are.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import NormalDist, fmean, stdev
from typing import TYPE_CHECKING

from riot_bus.monitors.envelope import norms_of, numbers_of
from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.vocabulary.message import Message

__all__ = ["FieldValues", "TopicValues", "bounds_of", "increases", "topics_of", "width_for"]

_LEAST_VALUES = 5
_DAY_NS = 86_400 * 10**9
_EPOCH_NS = 10**18
_UNIT_NS = (1, 10**3, 10**6, 10**9)


@dataclass(slots=True)
class FieldValues:
    """The values of one field in one trial."""

    values: list[float] = field(default_factory=list)
    clock: bool = True  # it is the time of the message, in some unit

    def add(self, value: float, time: int) -> None:
        """Take a value, and the time of its message in nanoseconds since the epoch."""
        self.values.append(value)
        if self.clock:
            near = (abs(value * unit - time) < _DAY_NS for unit in _UNIT_NS)
            self.clock = time > _EPOCH_NS and math.isfinite(value) and any(near)


@dataclass(slots=True)
class TopicValues:
    """The messages of one topic in one trial."""

    times: list[int] = field(default_factory=list)
    fields: defaultdict[str, FieldValues] = field(default_factory=lambda: defaultdict(FieldValues))
    norms: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    opaque: bool = False


def topics_of(view: TrialView) -> dict[str, TopicValues]:
    """Return what the outputs of a trial hold, by topic name."""
    found: defaultdict[str, TopicValues] = defaultdict(TopicValues)
    for message in view.outputs:
        if message.kind == "put":
            _take(found[view.registry.topic(message.key)], message, view)
    return dict(found)


def _take(topic: TopicValues, message: Message, view: TrialView) -> None:
    topic.times.append(message.time)
    kind = view.registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
    try:
        numbers = [] if kind is None else numbers_of(kind, message.payload)
        topic.opaque = topic.opaque or kind is None
    except PayloadError:
        topic.opaque = True
        return
    for name, _, value in numbers:
        topic.fields[name].add(value, message.time)
    for parent, (length, is_quaternion) in norms_of(numbers).items():
        topic.norms[parent].append(length if is_quaternion else -length)


def bounds_of(runs: Sequence[Sequence[float]], width: float) -> tuple[float, float]:
    """Return bounds of a field whose values are these, by trial; `width` is k of the module's formula."""
    lows, highs = [min(values) for values in runs], [max(values) for values in runs]
    low, high = min(lows), max(highs)
    margin = (high - low) / 2 or max(abs(high) / 2, 1.0)
    return min(low - margin, fmean(lows) - width * stdev(lows)), max(high + margin, fmean(highs) + width * stdev(highs))


def increases(fields: Sequence[FieldValues], width: float, *, clock: bool) -> bool:
    """Return whether a field never decreases, nor would in another trial: a clock, a counter, steps far from 0."""
    steps = [[after - before for before, after in pairwise(each.values)] for each in fields]
    if min(map(len, steps)) < _LEAST_VALUES or min(map(min, steps)) < 0 or not all(map(any, steps)):
        return False
    sizes = {step for run in steps for step in run}
    counter = len(sizes) <= 2 and all(step.is_integer() for step in sizes)
    least = [min(run) for run in steps]
    return clock or counter or fmean(least) - width * stdev(least) > 0


def width_for(chance: float, trials: int) -> float:
    """Return k of the module's formula; t by the expansion of Cornish and Fisher."""
    z, free = NormalDist().inv_cdf(1 - chance), trials - 1
    t = z + (z**3 + z) / (4 * free) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * free**2)
    t += (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * free**3)
    return (-math.log(chance) - 0.5772) / 1.2825 * t / z
