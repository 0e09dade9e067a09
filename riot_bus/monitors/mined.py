"""Rules mined from nominal trials: how a unit answers its probe, whatever exceptional input came before.

Exceptional inputs may rightly cause exceptional outputs. The only rule for these is that outputs are finite where all
inputs are. After them, each trial ends with the same nominal messages, the probe, and the answers to it are compared
with those in nominal trials. Two kinds of fields get no rule on their value: those that depend on what came before the
probe (sums, filters, estimates), as nominal trials with different histories show (the whole log, its first half), and
those that never change nominally (a count of rejected inputs, an error code).
"""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.statistics.rates import exact_interval
from riot_bus.types.by_payload import ByPayload, decoded
from riot_bus.types.capabilities import allows_non_finite
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_NO_NUMBERS = frozenset({"bool", "string", "bytes"})
_INDEX = re.compile(r"\[\d+\]")
_MOST_INPUT = 1e15
"""Squares and products of larger inputs may overflow in single precision."""
_MOST_ELEMENTS = 1 << 16
_MOST_KNOWN, _MOST_JUDGED = 1 << 12, 1 << 16
_ROOM, _SAME = 3.0, 1e-6
"""Bounds lie outside the nominal values by `_ROOM` times their spread, plus the share `_SAME` of their size. With six
trials and normal noise, they are then more than nine standard deviations from the mean."""
_SPARE = 4
"""One output in this many may be lost or come twice on a bus."""
_STALE_NS = 10 * 10**9
"""A loaded machine delays an output by a second or two, not by ten."""
_NORM_ALLOWED = 1e-2  # ten times what nominal trials may have, so that rounding alone breaks no rule


class _Answer(NamedTuple):
    """Numbers of one message by path; `odd` describes those that are NaN or infinite, with `[*]` for any element."""

    time: int
    numbers: Mapping[str, float]
    odd: Mapping[str, str]
    kind: MessageType | None


_Answers = dict[str, list[_Answer]]


@dataclass(frozen=True, slots=True)
class MinedRule:
    """A property that all answers to the probe had in common.

    Attributes:
        kind: `finite` (no number is NaN or infinite), `count` (of the topic's messages), `value` (of the field, message
            by message), `counter` (the field increases), `clock` (the field, in units of `unit` nanoseconds, is the
            time of the message, plus `low` to `high` nanoseconds), `norm` (the quaternion has length 1).
        field: Path of the field; in `finite`, with `[*]` for all elements of an array; empty for `count`.
        unit: Unit of a `clock` field, nanoseconds.
    """

    kind: str
    topic: str
    field: str = ""
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    unit: int = 1

    def __str__(self) -> str:
        """Return kind and field, as in signatures; elements of an array are one field."""
        return f"{self.kind} of {self.place}"

    @property
    def place(self) -> str:
        """Topic and field."""
        return self.topic + (f":{_INDEX.sub('[*]', self.field)}" if self.field else "")

    def broken(self, answers: Sequence[_Answer]) -> str:
        """Return what is wrong with the topic's answers to the probe, empty if nothing is."""
        if self.kind == "count":
            low, high = self.low[0], self.high[0]
            return "" if low <= len(answers) <= high else f"{len(answers)} messages, allowed: {low:g} to {high:g}"
        if self.kind == "finite":
            return next((each.odd[self.field] for each in answers if self.field in each.odd), "")
        found = [(each.time, each.numbers.get(self.field)) for each in answers]
        if self.kind == "norm":
            lengths = [length for each in answers if (length := _norm(each.numbers, self.field)) is not None]
            return next((f"{it:g} instead of 1" for it in lengths if abs(it - 1) > _NORM_ALLOWED), "")
        values = [value for _, value in found if value is not None]
        if self.kind == "counter":
            stuck = sum(step <= 0 for step in _steps(values))
            return f"does not increase, {stuck} times" if stuck > 1 else ""  # it may wrap around once
        if self.kind == "clock":
            lags = [value * self.unit - time for time, value in found if value is not None]
            if any(lag < self.low[0] or lag > self.high[0] for lag in lags):
                return f"{max(lags, key=abs) / 1e9:.1f} s from the time of the message"
            return ""
        if len(values) < len(found):
            return "is missing"
        if len(found) != len(self.low):
            return ""
        for number, (value, low, high) in enumerate(zip(values, self.low, self.high, strict=True)):
            if value < low or value > high:  # `finite` reports NaN
                return f"{self.field} = {value:g} in answer {number + 1}, allowed: {low:g} to {high:g}"
        return ""


@dataclass(frozen=True, slots=True)
class Mined:
    """A monitor made of mined rules.

    Attributes:
        rules: Rules to judge by.
        trials: Number of nominal trials that the rules were learnt from.
        alarms: Number of other nominal trials in which some rule fired.
        held_out: Number of these other trials.
        dropped: Rules that fired in these, and are not used.
    """

    rules: tuple[MinedRule, ...] = ()
    trials: int = 0
    alarms: int = 0
    held_out: int = 0
    dropped: tuple[str, ...] = ()

    def judge(self, view: TrialView) -> list[Violation]:
        """Return a violation for each broken rule; none for a unit that did not get through the probe."""
        found: dict[str, Violation] = {}
        for rule, what in () if view.probed is None else self._broken(view):
            detail = f"{what} ({self.origin})"
            found.setdefault(str(rule), Violation("mined", rule.place, f"mined {rule}", detail))
        return list(found.values())

    def differs(self, outputs: Sequence[Message], registry: TypeRegistry) -> bool:
        """Return whether answers to a probe break a rule."""
        answers = _answers(outputs, registry)
        return any(rule.broken(answers.get(rule.topic, [])) for rule in self.rules)

    @property
    def origin(self) -> str:
        """Origin of the rules, and how often they raise false alarms."""
        low, high = exact_interval(self.alarms, self.held_out)
        return (
            f"rule mined from {self.trials} nominal trials; in {self.alarms} of {self.held_out} others a rule fired, "
            f"95 %: {100 * low:.0f} to {100 * high:.0f} %"
        )

    def row(self) -> dict[str, Any]:
        """Return the monitor in the form of `campaign.json`."""
        low, high = exact_interval(self.alarms, self.held_out)
        return asdict(self) | {"low": low, "high": high}

    def _broken(self, view: TrialView) -> Iterator[tuple[MinedRule, str]]:
        answers = _answers(view.outputs[view.probed :], view.registry)
        miscounted: set[str] = set()
        for rule in sorted(self.rules, key=lambda rule: rule.kind != "count"):
            what = rule.broken(answers.get(rule.topic, []))
            if what and (rule.topic not in miscounted or rule.kind == "finite"):  # a wrong count may cause the rest
                yield rule, f"{what}, in answer to nominal input"
            if what and rule.kind == "count":
                miscounted.add(rule.topic)
        if any(_is_exceptional(message, view.registry) for message in view.inputs):
            return
        before = _answers(view.outputs[: view.probed], view.registry)
        for rule in self.rules:
            if rule.kind == "finite" and (what := rule.broken(before.get(rule.topic, []))):
                yield rule, what


NO_RULES = Mined()


def mine(histories: Sequence[Sequence[TrialView]]) -> tuple[MinedRule, ...]:
    """Return what the answers to the probe have in common.

    The trials come in groups with the same history before the probe.
    """
    groups = [[_answers(view.outputs[view.probed :], view.registry) for view in views] for views in histories]
    trials = list(chain.from_iterable(groups))
    shared = [topic for topic in trials[0] if all(topic in trial for trial in trials)]
    return tuple(
        chain.from_iterable(_rules(topic, [[trial[topic] for trial in group] for group in groups]) for topic in shared)
    )


def check_rules(rules: Sequence[MinedRule], judged: Iterable[Iterable[Violation]], *, trials: int) -> Mined:
    """Return the rules that none of the other nominal trials breaks; the rest is listed as dropped.

    Of the violations in each of the other trials, only those that `Mined` with these rules finds count.
    """
    fired = [{one.signature.removeprefix("mined ") for one in each if one.monitor == "mined"} for each in judged]
    wrong = set().union(*fired)
    kept = tuple(rule for rule in rules if str(rule) not in wrong)
    return Mined(kept, trials, sum(map(bool, fired)), len(fired), tuple(sorted(wrong)))


def _rules(topic: str, groups: Sequence[Sequence[list[_Answer]]]) -> Iterator[MinedRule]:
    trials = list(chain.from_iterable(groups))
    counts = {len(trial) for trial in trials}
    every = list(chain.from_iterable(trials))
    paths = sorted(set().union(*(answer.numbers for answer in every)))
    kinds = list({id(answer.kind): answer.kind for answer in every}.values())
    free = {_INDEX.sub("[*]", path) for path in paths if any(allows_non_finite(kind, path) for kind in kinds)}
    told = {_INDEX.sub("[*]", path) for path in paths}.difference(free, *(answer.odd for answer in every))
    for name in sorted(told):
        yield MinedRule("finite", topic, name)
    for parent in sorted({path.rpartition(".")[0] for path in paths if path.endswith(".w")}):
        lengths = [_norm(answer.numbers, parent) for answer in every]
        if all(length is not None and abs(length - 1) <= _NORM_ALLOWED / 10 for length in lengths):
            yield MinedRule("norm", topic, parent)
    count = counts.pop()
    if not counts:
        spare = count // _SPARE
        yield MinedRule("count", topic, low=(count - spare,), high=(count + spare,))
    for path in paths:
        if all(math.isfinite(answer.numbers.get(path, math.nan)) for answer in every):
            yield from _of_field(topic, path, groups, aligned=not counts)


def _of_field(
    topic: str, path: str, groups: Sequence[Sequence[list[_Answer]]], *, aligned: bool
) -> Iterator[MinedRule]:
    """Yield the rules on the values of one field that is in all messages."""
    times = [answer.time for answer in chain.from_iterable(chain.from_iterable(groups))]
    columns = [[[answer.numbers[path] for answer in trial] for trial in group] for group in groups]
    runs = list(chain.from_iterable(columns))
    values = list(chain.from_iterable(runs))
    for unit in (1, 10**3, 10**6, 10**9):
        lags = [value * unit - time for value, time in zip(values, times, strict=True)]
        if max(lags) - min(lags) < min(1e9, (max(times) - min(times)) / 2):
            yield MinedRule("clock", topic, path, (min(lags) - _STALE_NS,), (max(lags) + _STALE_NS,), unit)
            return
    if all(len(run) >= _SPARE and set(_steps(run)) == {1.0} for run in runs):
        yield MinedRule("counter", topic, path)
    if not aligned or any(len(set(run)) < 2 for run in runs):
        return
    places = list(zip(*runs, strict=True))
    within = max(_range(place) for column in columns for place in zip(*column, strict=True))
    spread, same = max(map(_range, places)), _SAME * max(map(abs, values))
    if spread > same and (_apart(columns, within + same) or all(min(_steps(run)) > 0 for run in runs)):
        return  # it depends on the history, or increases with time
    room = _ROOM * spread + same
    yield MinedRule(
        "value", topic, path, tuple(min(it) - room for it in places), tuple(max(it) + room for it in places)
    )


def _apart(columns: Sequence[Sequence[Sequence[float]]], gap: float) -> bool:
    """Return whether groups of trials differ by more than `gap` at some message."""
    for places in zip(*(zip(*column, strict=True) for column in columns), strict=True):
        lows, highs = [min(place) for place in places], [max(place) for place in places]
        if max(lows) - min(highs) > gap:
            return True
    return False


def _answers(outputs: Sequence[Message], registry: TypeRegistry) -> _Answers:
    found: _Answers = {}
    for message in outputs:
        if message.kind == "put":
            answer = _Answer(message.time, *_numbers(message, registry))
            found.setdefault(registry.topic(message.key), []).append(answer)
    return found


def _numbers_of(
    kind: MessageType | None, payload: bytes
) -> tuple[Mapping[str, float], Mapping[str, str], MessageType | None]:
    """Return `numbers`, `odd` and `kind` of an `_Answer`."""
    numbers = {leaf.path: float(leaf.value) for leaf in decoded.of(kind, payload) if leaf.type not in _NO_NUMBERS}
    odd = {
        _INDEX.sub("[*]", path): f"{path} = {value!r}"
        for path, value in reversed(numbers.items())  # so that the first element is kept
        if not math.isfinite(value)
    }
    return numbers, odd, kind


_numbers = ByPayload(_numbers_of, most=_MOST_KNOWN)


def _norm(numbers: Mapping[str, float], parent: str) -> float | None:
    """Return the length of a quaternion, None if there is none."""
    members = [numbers.get(f"{parent}.{member}") for member in "xyzw"]
    return None if None in members else math.hypot(*(member for member in members if member is not None))


def _steps(values: Sequence[float]) -> list[float]:
    return [after - before for before, after in pairwise(values)]


def _range(values: Sequence[float]) -> float:
    return max(values) - min(values)


def _holds_large(kind: MessageType | None, payload: bytes) -> bool:
    """Return whether this input may rightly cause infinite outputs, or cannot be decoded."""
    try:
        leaves = () if kind is None else kind.leaves(payload, elements=_MOST_ELEMENTS)
    except PayloadError:
        leaves = ()
    return not leaves or any(_is_large(leaf.value) for leaf in leaves)


_is_exceptional = ByPayload(_holds_large, most=_MOST_JUDGED)


def _is_large(value: Any) -> bool:
    """Return whether a number, or the text of one, is NaN or large enough to cause infinite results."""
    try:
        return not abs(float(value)) <= _MOST_INPUT
    except (OverflowError, TypeError, ValueError):
        return isinstance(value, int)
