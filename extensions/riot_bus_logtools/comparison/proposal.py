"""Tolerances learnt from nominal runs: the differences among them, with a margin; pure.

The tolerance of a field is the largest difference between any two of the runs, times a margin. If all pairs of runs
differ by about the same at most, and the differences in each often change their sign, this is noise within the runs,
and a margin of 2 suffices. Otherwise each run may have an offset or a drift of its own, and a few runs show little of
it: if it is drawn from a normal distribution, a further pair of runs stays in 99 of 100 cases within 7.3 times the
largest difference of three runs, 3.7 times that of four, 2.7 of five, 2.2 of six (by 400,000 draws). Two runs are one
pair, which does not show this; their margin is 5, enough in 87 of 100.

A difference that grows and shrinks within a run has a heavier tail: in a closed loop, one delay changes the way of the
rest of the run. Of 43 runs of such a loop in real time, further pairs stay in 99 of 100 cases within 20 times the
largest difference of four to six runs, 10 times that of eight to ten, 6.5 of fifteen; of 43 runs of another loop within
7.6, 3 and 1.6 times. With three runs it is 95 of 100: they may all be without a delay, which no margin makes up for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from riot_bus.log.showing import value_text
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from riot_bus.vocabulary.toml_text import toml_string, toml_value
from riot_bus_logtools.comparison.tolerances import TABLE, TopicTolerances, entry_of

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus_logtools.comparison.parts import FieldDifference, TopicDifference
    from riot_bus_logtools.comparison.result import LogDifference

_MARGIN = 2.0
_MARGINS = {2: 5.0, 3: 7.3, 4: 3.7, 5: 2.7, 6: 2.2}
"""Margins by number of runs, if the runs may have offsets."""
_DRIFT_MARGINS = ((15, 6.5), (8, 10.0), (0, 20.0))
"""Margins by least number of runs, if differences grow and shrink within a run."""
_ALIKE = 0.7
"""For noise within runs, the largest difference of each pair is at least this share of the largest one of all."""
_TURNS = 0.3
"""For noise within runs, at least this share of the differences in each pair has another sign than the one before: of
100 independent ones, it is half of them, and less than this once in 40,000 cases.
"""
_OFTEN, _FEW = 0.9, 10
"""A field that differs in this share of the messages, and in at least so many, counts as differing in all."""
_ANEW = 1 / 8
"""If values are drawn anew each time, half of the differences are larger than this share of their range."""
_OFFSET = 0.8
"""If a run has an offset of its own, half of the differences are larger than this share of the largest one."""


@dataclass(frozen=True, slots=True)
class Proposed:
    """A tolerance proposed for a field (`TOPIC:PATH`), or for the number of messages of a topic; it may be `ignore`."""

    name: str
    value: float | str
    reason: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """Tolerances with which nominal runs are the same, from so many pairs of runs and of messages.

    In unsettled topics, pairs of runs still differ.
    """

    logs: tuple[str, ...]
    pairs: int
    messages: int
    tolerances: tuple[Proposed, ...] = ()
    unsettled: tuple[str, ...] = ()

    def check(self) -> None:
        """Raise InconclusiveError if nothing was compared, or if the runs still differ."""
        if not self.messages:
            raise InconclusiveError("no two of these logs have a message in common", where=", ".join(self.logs))
        if self.unsettled:
            told = ", ".join(self.unsettled)
            hint = "say what is tolerated there: riot diff A B --tolerance TOPIC:PATH=..."
            raise InconclusiveError(f"with these tolerances, the runs still differ in {told}", hint=hint)

    def write(self, path: Path) -> None:
        """Write a file for `riot diff --tolerances`; raises ConfigError if it cannot be written there."""
        try:
            path.write_text(self.toml(), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write the tolerances: {error.strerror}", where=str(path)) from error

    def given(self) -> TopicTolerances:
        """Return the tolerances as `riot diff` takes them."""
        return TopicTolerances([entry_of(each.name, each.value) for each in self.tolerances])

    def toml(self) -> str:
        """Return the text of a file for `riot diff --tolerances`."""
        rows = [
            f"# {_comment(each.reason)}\n{toml_string(each.name)} = {toml_value(each.value)}"
            for each in self.tolerances
        ]
        return "\n".join([*self._head(), f"[{TABLE}]", *rows]) + "\n"

    def lines(self) -> Iterator[str]:
        """Yield the tolerances as lines of text."""
        yield (
            f"{counted(len(self.tolerances), 'tolerance')} from {counted(self.messages, 'pair')} of messages "
            f"of {counted(len(self.logs), 'log')} ({counted(self.pairs, 'pair')})"
        )
        for each in self.tolerances:
            yield f"  {each.name} = {each.value}  ({each.reason})"

    def to_json(self) -> dict[str, Any]:
        """Return the tolerances as JSON values."""
        facts = asdict(self).items()
        return {"version": 1} | {name: list(value) if isinstance(value, tuple) else value for name, value in facts}

    def _head(self) -> Iterator[str]:
        yield f"# Proposed by riot diff --propose from {counted(self.pairs, 'pair')} of nominal runs:"
        yield from (f"#   {_comment(name)}" for name in self.logs)
        yield f"# {counted(self.messages, 'pair')} of messages. Numbers are the largest difference times a margin; in"
        yield f"# about 1 of {self.pairs + 1} cases a further pair of runs exceeds that difference itself."
        yield from (f"# NOT SETTLED: {_comment(name)}" for name in self.unsettled)
        yield ""


def margin_of(runs: int, fields: Sequence[FieldDifference] = (), *, pairs: int = 0) -> float:
    """Return the margin by which the largest difference among runs is multiplied.

    Args:
        fields: Differences of a field in those pairs of runs in which it differs; empty for a quantity of which each
            run has one figure.
    """
    largest = [each.largest or 0.0 for each in fields]
    if _drifts(fields):
        return next(margin for least, margin in _DRIFT_MARGINS if runs >= least)
    turns = min((each.turns for each in fields), default=0.0)
    noise = 1 < pairs == len(fields) and turns >= _TURNS and min(largest) >= _ALIKE * max(largest)
    return _MARGIN if noise else _MARGINS.get(runs, _MARGIN)


def _drifts(fields: Sequence[FieldDifference]) -> bool:
    """Return whether differences grow and shrink within a run, neither noise nor an offset of each run."""
    wander = any(each.turns < _TURNS for each in fields)
    return wander and any((each.typical or 0.0) < _OFFSET * (each.largest or 0.0) for each in fields)


def propose(names: Sequence[str], compared: Callable[[TopicTolerances], Sequence[LogDifference]]) -> Proposal:
    """Propose tolerances with which nominal runs are the same."""
    found = compared(TopicTolerances())
    proposal = Proposal(tuple(names), len(found), sum(each.compared for each in found))
    known: dict[str, Proposed] = {}
    for _ in range(3):  # with other tolerances, messages may pair differently
        known |= _proposed(found, known, len(names))
        proposal = replace(proposal, tolerances=tuple(known[name] for name in sorted(known)))
        found = compared(proposal.given())
        if all(each.same for each in found):
            return proposal
    unsettled = dict.fromkeys(topic.topic for each in found for topic in each.topics if not topic.same)
    return replace(proposal, unsettled=tuple(unsettled))


def _proposed(found: Sequence[LogDifference], known: Mapping[str, Proposed], runs: int) -> dict[str, Proposed]:
    """Return the tolerances needed for all these to be the same, as far as they are new or wider than known ones."""
    topics: dict[str, list[TopicDifference]] = {}
    for topic in (topic for each in found for topic in each.topics if not topic.same):
        topics.setdefault(topic.topic, []).append(topic)
    rows: dict[str, Proposed] = {}
    for name, differing in topics.items():
        every = [topic for each in found for topic in each.topics if topic.topic == name]
        total = sum(topic.equal + topic.changed for topic in every)
        fields: dict[str, list[FieldDifference]] = {}
        for one in (one for topic in differing for one in topic.fields):
            fields.setdefault(one.name, []).append(one)
        margins = {path: margin_of(runs, ones, pairs=len(every)) for path, ones in fields.items()}
        for path, ones in fields.items():
            rows[f"{name}:{path}"] = _of_field(f"{name}:{path}", ones, total, margins[path])
        drifting = [margins[path] for path, ones in fields.items() if _drifts(ones)]
        shifted = max(topic.shifted for topic in every)
        if shifted > differing[0].allowed:
            margin = max([margin_of(runs), *drifting])
            counts = [count for topic in every for count in (topic.count_a, topic.count_b)]
            told = f"{shifted} were lost, added or out of order at most, times {margin:g}"
            reason = f"{told}; there are {min(counts)} to {max(counts)}"
            rows[name] = Proposed(name, math.ceil(margin * shifted), reason)
        elif drifting:
            rows[name] = Proposed(name, 2, "another run may begin and end a message earlier or later")
    former = {name: each for name, each in known.items() if name in rows}
    return {name: each for name, each in rows.items() if _wider(each, former.get(name))}


def _wider(each: Proposed, former: Proposed | None) -> bool:
    if former is None or isinstance(each.value, str):
        return True
    return not isinstance(former.value, str) and each.value > former.value


def _of_field(name: str, ones: Sequence[FieldDifference], total: int, margin: float) -> Proposed:
    """Return the tolerance proposed for a field from its differences in all pairs of runs in which it differs."""
    messages = sum(one.messages for one in ones)
    where = f"differs in {messages} of {counted(total, 'message')}"
    unlike, example = sum(one.unlike for one in ones), ones[0].example
    if unlike:
        values = f"such as {value_text(example.before)} and {value_text(example.after)}"
        return Proposed(name, "ignore", f"{where}, and is no number in {unlike} of them, {values}")
    largest = max(one.largest or 0.0 for one in ones)
    if not math.isfinite(largest):
        return Proposed(name, "ignore", f"{where}, and is infinite or NaN in one run alone")
    typical = sorted(one.typical or 0.0 for one in ones)[len(ones) // 2]
    low = min(one.low for one in ones if one.low is not None)
    high = max(one.high for one in ones if one.high is not None)
    spread, whole = high - low, all(one.whole for one in ones)
    values = f"its values are {low:.6g} to {high:.6g}"
    if messages >= max(_FEW, _OFTEN * total) and typical >= _ANEW * spread:
        if all((one.typical or 0.0) >= _OFFSET * (one.largest or 0.0) for one in ones):
            return Proposed(name, "ignore", f"{where}, by much the same in each: every run has its own; {values}")
        if whole:
            return Proposed(name, "ignore", f"{where}, as if drawn anew in each run; {values}")
    value = math.ceil(margin * largest) if whole else _rounded_up(margin * largest)
    gross = "; as large as that range, so it finds gross changes alone" if value >= spread else ""
    return Proposed(name, value, f"{where}, by {largest:.6g} at most, times {margin:g}; {values}{gross}")


def _rounded_up(number: float) -> float:
    """Return a number rounded up to two digits."""
    if number <= 0.0:
        return 0.0
    digits = 1 - math.floor(math.log10(number))
    found = round(number, digits)
    return found if found >= number else round(found + 10.0**-digits, digits)


def _comment(text: str) -> str:
    """Return a text without line breaks, for a comment in TOML."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
