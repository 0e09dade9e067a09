"""Simpler modifications of a short failing log, as a person would write them, with which it still fails.

In this order: the shortest times between messages, if they matter; payloads and fields back to nominal; then what still
has to be modified, towards simple values: 0, 1, powers of ten, the limit of a type, short texts and arrays. Unmodified
values stay as recorded: the steps that follow vary them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Literal

from riot_bus.chain.base.logs import FailingLog, NamedFields
from riot_bus.chain.unit.questions import json_value
from riot_bus.findings.records import SimplifiedRecord
from riot_bus.generalize.forms.standalone import INTEGERS
from riot_bus.generalize.oracle import same_scalar
from riot_bus.generalize.simplify import Levels, simplify
from riot_bus.statistics.noise import Noise
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import PayloadError, RiotError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Ask, Progress

_LARGEST = 10.0**38
"""Limit of a float32: a number of this size or more stands for infinity."""


@dataclass(frozen=True, slots=True)
class _Ladder:
    """One thing that can be simplified: its name, and its values, the simplest first, the present one last."""

    what: Literal["gap", "payload", "field"]
    name: str
    rungs: tuple[Scalar, ...]
    position: int = 0


_Build = Callable[[Levels], FailingLog]


@dataclass(slots=True)
class Simplification:
    """Simplifies a failing log.

    Args:
        observed: Function that returns the values of fields (by name) in nominal messages; these explain nothing.
    """

    log: FailingLog
    failing: Ask[FailingLog]
    registry: TypeRegistry
    paced: bool
    observed: Callable[[NamedFields], Mapping[str, Sequence[Scalar]]]
    better: Callable[[FailingLog], None]
    records: list[SimplifiedRecord] = field(default_factory=list)
    trials: int = 0

    def run(self, *, noise: Noise, budget: int, parallelism: int, progress: Progress | None) -> Noise:
        """Simplify the log; return what is then known about the failure rates."""
        for stage in (self._gaps, self._payloads, self._fields):
            ladders, build = stage()
            if not ladders or self.trials >= budget:
                continue

            def ask(questions: Sequence[Levels], build: _Build = build) -> list[bool]:
                logs: list[FailingLog | None] = [None] * len(questions)
                for place, levels in enumerate(questions):
                    with suppress(PayloadError):  # such a log cannot be written, so it does not fail
                        logs[place] = build(levels)
                answers = iter(self.failing([log for log in logs if log is not None]))
                return [log is not None and next(answers) for log in logs]

            found = simplify(
                [len(ladder.rungs) for ladder in ladders],
                ask,
                noise=noise,
                budget=budget - self.trials,
                parallelism=parallelism,
                progress=progress,
                better=lambda levels, build=build: self.better(build(levels)),  # type: ignore[misc]
            )
            noise = found.noise
            self.trials += found.trials
            self.log = build(found.levels)
            self.records += _records(ladders, found.levels)
        return noise

    def _gaps(self) -> tuple[list[_Ladder], _Build]:
        log = self.log
        names = self.log.names(self.registry)
        gaps = [max(0, after.time - before.time) for before, after in pairwise(log.messages)] if self.paced else []
        ladders = [
            _Ladder("gap", f"{before} to {after}", (*_durations(gap), gap), position)
            for position, (gap, before, after) in enumerate(zip(gaps, names, names[1:], strict=False))
            if gap
        ]

        def build(levels: Levels) -> FailingLog:
            chosen = list(gaps)
            for ladder, level in zip(ladders, levels, strict=True):
                chosen[ladder.position] = int(ladder.rungs[level])
            return spaced(log, chosen)

        return ladders, build

    def _payloads(self) -> tuple[list[_Ladder], _Build]:
        """Return ladders that restore whole payloads, if several were modified or fields do not show how."""
        log, names = self.log, self.log.names(self.registry)
        places = [place for place, one in enumerate(log.messages) if _changed(one, log.originals.get(one.sequence))]
        if len(places) == 1 and self._told_by_fields(places[0]):
            places = []
        ladders = [_Ladder("payload", names[place], (True, False), place) for place in places]

        def build(levels: Levels) -> FailingLog:
            messages = list(log.messages)
            for ladder, level in zip(ladders, levels, strict=True):
                if ladder.rungs[level]:
                    before = log.originals[messages[ladder.position].sequence]
                    messages[ladder.position] = messages[ladder.position].with_(
                        payload=before.payload, encoding=before.encoding, attachment=before.attachment
                    )
            return _pruned(messages, log.originals)

        return ladders, build

    def _told_by_fields(self, place: int) -> bool:
        fields = NamedFields(self.log, registry=self.registry)
        changed = {name: one.original for name, one in fields.fields.items() if one.original is not None}
        message = self.log.messages[place]
        try:
            return fields.with_values(changed)[place].payload == self.log.originals[message.sequence].payload
        except RiotError:
            return False

    def _fields(self) -> tuple[list[_Ladder], _Build]:
        log = self.log
        fields = NamedFields(log, registry=self.registry)
        observed = self.observed(fields)
        ladders = [
            _Ladder("field", name, rungs_of(one.leaf.path, one.leaf.type, one.leaf.value, one.original, observed[name]))
            for name, one in fields.fields.items()
            if one.original is not None
        ]

        def build(levels: Levels) -> FailingLog:
            values = {ladder.name: ladder.rungs[level] for ladder, level in zip(ladders, levels, strict=True)}
            return _pruned(fields.with_values(values), log.originals)

        return ladders, build


def _records(ladders: Sequence[_Ladder], levels: Levels) -> Iterator[SimplifiedRecord]:
    for ladder, level in zip(ladders, levels, strict=True):
        if level == len(ladder.rungs) - 1:
            continue
        before, after = ladder.rungs[-1], ladder.rungs[level]
        nominal = ladder.what != "gap" and level == 0
        what = "nominal" if nominal else "gap" if ladder.what == "gap" else "value"
        if ladder.what == "gap":
            before, after = int(before) / 1e9, int(after) / 1e9
        values = (None, None) if ladder.what == "payload" else (json_value(before), json_value(after))
        yield SimplifiedRecord(what=what, name=ladder.name, before=values[0], after=values[1])


def _changed(message: Message, original: Message | None) -> bool:
    return original is not None and message.digest() != original.digest()


def _pruned(messages: Sequence[Message], originals: Mapping[int, Message]) -> FailingLog:
    """Return a log in which messages equal to their originals, and neither delayed nor repeated, are unmodified."""
    copies = Counter(message.sequence for message in messages)
    left = {
        one.sequence: originals[one.sequence]
        for one in messages
        if one.sequence in originals
        and (
            _changed(one, originals[one.sequence])
            or one.time != originals[one.sequence].time
            or copies[one.sequence] > 1
        )
    }
    return FailingLog(tuple(messages), left)


def spaced(log: FailingLog, gaps: Sequence[int]) -> FailingLog:
    """Return a log with these gaps between its messages, in nanoseconds; originals move with modified messages."""
    if not log.messages:
        return log
    times = accumulate(gaps, initial=log.messages[0].time)
    messages = tuple(message.with_(time=time) for message, time in zip(log.messages, times, strict=True))
    shifts = {new.sequence: new.time - old.time for old, new in zip(log.messages, messages, strict=True)}
    originals = {number: one.with_(time=one.time + shifts[number]) for number, one in log.originals.items()}
    return FailingLog(messages, originals)


def _durations(gap: int) -> list[int]:
    """Return simple durations below a gap, in nanoseconds: 0, then 1, 2, 5, 10, ... milliseconds."""
    steps = (digit * 10**power for power in range(6, 12) for digit in (1, 2, 5))
    return [0, *(step for step in steps if step < gap)]


def rungs_of(
    path: str, kind: str, value: Scalar, nominal: Scalar, observed: Sequence[Scalar] = ()
) -> tuple[Scalar, ...]:
    """Return the values that may replace a failing one, the simplest first: the nominal value, then simple ones."""
    if path.startswith("len("):
        simple: list[Scalar] = [2**power for power in range(17) if int(nominal) < 2**power < int(value)]
    elif isinstance(value, bool):
        simple = []
    elif isinstance(value, (int, float)):
        simple = list(_numbers(value, kind))
    else:
        simple = [value[:length] for length in (0, *(2**power for power in range(24))) if length < len(value)]
    rungs: list[Scalar] = [nominal]
    for one in simple:
        if not any(same_scalar(one, other) for other in (value, *rungs, *observed)):
            rungs.append(one)
    return (*rungs, value)


def _numbers(value: int | float, kind: str) -> Iterator[int | float]:
    """Yield simple numbers of a value's sign: 0, 1, powers of ten below it, a round one above it, its type's limit."""
    if math.isnan(value):
        return
    sign, size = (-1 if value < 0 else 1), abs(value)
    as_typed: Callable[[int], int | float] = float if isinstance(value, float) else int
    yield as_typed(0)
    yield as_typed(sign)
    power = 10
    while power < min(size, _LARGEST):
        yield as_typed(sign * power)
        power *= 10
    if size >= _LARGEST:
        return
    above = sign * -(-size // (power // 10)) * (power // 10)
    if isinstance(value, float):
        yield float(above)
    elif kind in INTEGERS:
        low, high = INTEGERS[kind]
        yield from (one for one in (int(above), low if sign < 0 else high) if low <= one <= high)
