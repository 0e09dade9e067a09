"""Injections: for messages of topic T in [t1, t2] (and while predicate P), set field f to v, or apply a timing fault.

This is data only; `riot_bus.inject` reads plans and carries them out.
"""

from __future__ import annotations

import random
from bisect import bisect_right
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus.vocabulary.message import Scalar

PARAMETERS = "#param"
"""Topic of injections that set a parameter of commands instead of a field of messages; no key has this name."""


@lru_cache(1 << 12)  # a value is asked for again for each message for which it is held
def _draw(seed: int, block: int) -> float:
    return random.Random(f"{seed}:{block}").uniform(-1.0, 1.0)  # noqa: S311


@dataclass(frozen=True, slots=True)
class Signal:
    """A random piecewise-constant signal over the messages of one topic (RIOT II-C: perturbation of system inputs).

    The value depends only on the seed and the per-topic index, never on arrival order across topics.

    Attributes:
        center: Middle of the range, in the field's unit.
        amplitude: Half of the range.
        hold: Number of messages for which a value is kept.
        seed: Seed of this signal.
        integer: Whether values are rounded.
        choices: Values to set instead of the number, which is rounded and used as their index (from 0); empty to set
            the number itself.
    """

    center: float
    amplitude: float
    hold: int = 5
    seed: int = 0
    integer: bool = False
    choices: tuple[Scalar, ...] = ()

    def value(self, index: int) -> float:
        """Return the value for the topic's `index`-th message (0, 1, ...)."""
        value = self.center + self.amplitude * _draw(self.seed, index // self.hold)
        return float(round(value)) if self.integer else value

    def injected(self, index: int) -> Scalar:
        """Return the value or choice that the topic's `index`-th message gets."""
        value = self.value(index)
        return self.choices[min(max(round(value), 0), len(self.choices) - 1)] if self.choices else value


@dataclass(frozen=True, slots=True)
class Curve:
    """A value over time, linear between points, and constant before the first and after the last point.

    Attributes:
        times: Times of the points, in seconds since the first message that the pipeline saw, strictly increasing.
        values: Values at the points, in the field's unit.
        integer: Whether values are rounded.

    Raises:
        ValueError: There is no point, the numbers of values and times differ, or the times do not increase.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    integer: bool = False

    def __post_init__(self) -> None:
        if not self.times or len(self.times) != len(self.values):
            raise ValueError(f"a curve needs as many values as times, not {len(self.values)} and {len(self.times)}")
        if not all(before < after for before, after in pairwise(self.times)):
            raise ValueError(f"the times of a curve have to rise, not {', '.join(map(str, self.times))}")

    def value(self, seconds: float) -> float:
        """Return the value of a message at a time."""
        at = bisect_right(self.times, seconds)
        if at in (0, len(self.times)):
            value = self.values[max(at - 1, 0)]
        else:
            share = (seconds - self.times[at - 1]) / (self.times[at] - self.times[at - 1])
            value = self.values[at - 1] + share * (self.values[at] - self.values[at - 1])
        return float(round(value)) if self.integer else value


@dataclass(frozen=True, slots=True)
class Formula:
    """A value that depends on other fields of the message, as they were before any injection: `width + 1`.

    Attributes:
        text: Text of the formula; see `riot_bus.inject.formula`.
        base: Path of the part of the message whose fields the text names; empty for the whole message.
    """

    text: str
    base: str = ""


@dataclass(frozen=True, slots=True)
class Injection:
    """One injection policy.

    Attributes:
        topic: Topic name or key expression of the messages.
        field: Field path that is set; None for a timing fault.
        value: Value that is set, or a `Signal`, `Curve` or `Formula` that gives one per message.
        fault: Kind of fault: `set`, `omit`, `truncate`, `drop`, `delay`, `duplicate`, or a kind of another package.
        start: Earliest time, in seconds since the first message that the pipeline saw.
        end: Latest time (exclusive), in seconds; None for no limit.
        first: First per-topic message index.
        last: Last per-topic message index (inclusive); None for no limit.
        where: Predicate on the message's fields, such as `mode == 2 and speed > 1.5`; None for always.
        probability: Share of the selected messages, chosen by the message's content and the seed.
        delay: Delay in seconds, for `fault = "delay"`.
        copies: Number of extra copies, for `fault = "duplicate"`.
        seed: Seed of the choice of messages.
        options: Names and values of further options, for kinds of faults that have some.
    """

    topic: str
    field: str | None = None
    value: Scalar | Signal | Curve | Formula | None = None
    fault: str = "set"
    start: float = 0.0
    end: float | None = None
    first: int = 0
    last: int | None = None
    where: str | None = None
    probability: float = 1.0
    delay: float = 0.0
    copies: int = 1
    seed: int = 0
    options: tuple[tuple[str, Scalar], ...] = ()

    def row(self) -> dict[str, Any]:
        """Return the form for findings and digests, where attributes added in later versions are omitted if empty."""
        row = asdict(self)
        if not self.options:
            del row["options"]
        if isinstance(self.value, Signal) and not self.value.choices:
            del row["value"]["choices"]
        return row
