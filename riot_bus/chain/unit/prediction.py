"""Prediction of a rule for a whole log: the messages at which the unit would fail."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riot_bus.chain.base.injections import injection_of
from riot_bus.chain.base.systems import described
from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.unit.questions import json_value
from riot_bus.findings.records import MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.inject.apply import inject_log
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.reader import LogReader
from riot_bus.types.latest import LatestFields, in_words
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Verdict

_TOLD = 20  # lines of moments: about a screen


_SAID = {True: "would fail", False: "would not fail", None: "not known whether it would fail"}


@dataclass(frozen=True, slots=True)
class Moment:
    """A message of a log by which a rule can be judged.

    Attributes:
        time: Time at which it was sent (ns).
    """

    place: int
    time: int
    values: Mapping[str, Scalar]
    last: bool = True


@dataclass(slots=True)
class Prediction:
    """The prediction of a rule for a log.

    Attributes:
        judged: Number of messages at which the known fields of the rule decided whether it holds. Those of other topics
            than the last of the rule's count only if the rule holds or all fields are known.
        unknown: Number of messages of the last of the rule's topics at which they did not.
        begin: Time at which the first message of the log was sent (ns).
    """

    rule: str = ""
    topics: Sequence[str] = ()
    begin: int = 0
    judged: int = 0
    unknown: int = 0
    fails: int = 0
    missed: int = 0
    moments: list[Moment] = field(default_factory=list)

    @property
    def would_fail(self) -> bool | None:
        """Whether the unit would fail; None if that is not known, as the rule holds nowhere but may hold somewhere."""
        return True if self.fails else None if self.unknown else False

    def lines(self) -> list[str]:
        """Return the prediction as lines of text."""
        of = f"{counted(self.judged, 'message')} of its topics"
        first = f"{_SAID[self.would_fail]}: the rule {self.rule} holds at {self.fails} of {of}"
        found = [first + (f"; at {self.unknown} more it is not known" if self.unknown else "")]
        if self.missed and not self.fails:
            found.append(f"  {counted(self.missed, 'trial')} of the campaign failed though it holds nowhere in them")
        for one in self.moments[:_TOLD]:
            values = ", ".join(f"{in_words(name, self.topics)} = {value!r}" for name, value in one.values.items())
            found.append(f"  {(one.time - self.begin) / 1e9:.3f} s, message {one.place}: {values}")
        return found + ([f"  ... and {self.fails - _TOLD} more"] if self.fails > _TOLD else [])

    def to_json(self) -> dict[str, Any]:
        """Return the prediction as a JSON object."""
        moments = [
            {"message": one.place, "time": one.time, "values": {n: json_value(v) for n, v in one.values.items()}}
            for one in self.moments
        ]
        figures = {"judged": self.judged, "unknown": self.unknown, "fails": self.fails, "missed": self.missed}
        return {"rule": self.rule, "would_fail": self.would_fail, **figures, "moments": moments}


class Explained(NamedTuple):
    """Comparison of a rule with earlier trials.

    Attributes:
        wrong: Trials that the rule predicts wrongly: what was injected, and whether they failed.
        holds: Numbers, if the failure occurs only sometimes: the failed and all trials in which the rule holds.
        unknown: Number of other trials: the rule holds nowhere in them, but could not be judged at some messages.
        keeps: Whether messages that lack a field were taken to leave its earlier value in force.
    """

    trials: int
    wrong: list[tuple[list[dict[str, Any]], bool]]
    holds: tuple[int, int]
    unknown: int = 0
    keeps: bool = False


class _Tried(NamedTuple):
    """An earlier trial: what was injected, whether it failed, and whether the rule says so.

    Attributes:
        said: Value of `Prediction.would_fail`.
        kept: The same if messages that lack a field leave its earlier value in force.
    """

    rows: list[dict[str, Any]]
    failed: bool
    said: bool | None
    kept: bool | None


def explained(record: RuleRecord, step: StepRun, unit: str, signature: str, *, rate: float = 1.0) -> Explained:
    """Compare a rule with the trials that campaigns have run on the nominal log already; nothing is run.

    Trials that failed in another way do not count, since they do not show whether this failure would have occurred.
    Nor do trials, failing or passing, in which the rule holds nowhere but could not be judged everywhere, such as
    before the first message of a topic: `unknown` counts those; nor passing ones where the rule holds, if the failure
    occurs only sometimes: `holds` counts those.

    A message that lacks a field leaves the earlier value in force if the trials show this: of those in which the rule
    holds only with earlier values, more failed than passed.

    """
    rule, registry = Rule.from_json(record.rule), step.workspace.context.registry
    log = step.workspace.unit_log(unit)
    after = step.workspace.runners.baseline(unit, lambda: log).follows  # trials played this, too
    told = [
        (rows, seed, outcome.failed_as(signature))
        for rows, seed, outcome in step.tried(unit)
        if outcome.verdict is Verdict.PASS or outcome.failed_as(signature)
    ]
    told = told[:: max(1, -(-len(told) * len(log) // 300_000))]  # messages: about half a minute
    tried: list[_Tried] = []
    for rows, seed, failed in told:
        injections = [injection_of(row, "trials") for row in rows]
        messages, _ = inject_log(log, injections, registry=registry, seed=seed)
        played = (*messages, *after)
        found = kept = predict(rule, record.topics, played, registry=registry, at_most=1)
        if found.unknown:
            kept = predict(rule, record.topics, played, registry=registry, at_most=1, keeps=True)
        tried.append(_Tried(rows, failed, found.would_fail, kept.would_fail))
    keeps = _shows_keeping(tried)
    judged = [one._replace(said=one.kept) if keeps else one for one in tried]
    unknown = sum(one.said is None for one in judged)
    sometimes = rate < 0.95
    held = [one.failed for one in judged if one.said and sometimes]
    counts = [one for one in judged if one.said is not None and not (one.said and not one.failed and sometimes)]
    wrong = [(one.rows, one.failed) for one in counts if one.said != one.failed]
    return Explained(len(counts), wrong, (sum(held), len(held)), unknown, keeps)


def _shows_keeping(tried: Sequence[_Tried]) -> bool:
    """Return whether the trials show that messages that lack a field leave its earlier value in force."""
    gained = sum((one.kept is True) - (one.said is True) for one in tried if one.failed)
    alarms = sum((one.kept is True) - (one.said is True) for one in tried if not one.failed)
    return gained > max(0, alarms)


def predict(
    rule: Rule,
    topics: Sequence[str],
    messages: Iterable[Message],
    *,
    registry: TypeRegistry,
    at_most: int = 100,
    keeps: bool = False,
) -> Prediction:
    """Judge each message of a log by the latest messages of the rule's topics.

    Where some fields are unknown, the rule holds if a term does whose fields are all known, and does not if each term
    has a known comparison that does not. An order is known only at messages of its second topic.

    Raises:
        ConfigError: A variable of the rule is not a field.
    """
    latest = LatestFields(rule.variables, topics, registry=registry, keeps=keeps)
    found = Prediction(rule_text(rule, topics), topics)
    log = iter(messages)
    first = next(log, None)
    if first is not None:
        found.begin, log = first.time, chain([first], log)
    for rows in moments_of(latest, log, topics, registry=registry):
        groups: dict[tuple[str, ...], list[Moment]] = {}
        for row in rows:
            groups.setdefault(tuple(row.values), []).append(row)
        failing = [moment for names, group in groups.items() for moment in _judge_alike(rule, names, group, found)]
        failing.sort(key=lambda moment: moment.place)
        found.moments += failing[: at_most - len(found.moments)]
    return found


def predict_log(path: Path, folder: Path) -> Prediction:
    """Return the prediction of a finding's rule for a log.

    Raises:
        ConfigError: There is no such log, or the finding has no rule.
        InconclusiveError: The rule can be judged at no message of the log.
    """
    record, minimal = RuleRecord.load(folder), MinimalRecord.find(folder)
    rule, topics = Rule.from_json(record.rule), record.topics or (minimal.topics if minimal else ())
    _, registry = described(folder)
    with LogReader(path) as reader:
        learn_types(reader, registry)
        found = predict(rule, topics, bus_messages(reader, registry), registry=registry, keeps=record.keeps)
    if not found.judged:
        raise InconclusiveError(
            f"the known fields never decide whether the rule {record.text} holds",
            where=str(path),
            hint=f"{counted(found.unknown, 'message')} of its topics came; `riot info` says what the log holds",
        )
    found.missed = record.missed
    return found


def rule_text(rule: Rule, topics: Sequence[str]) -> str:
    """Return a rule as text; `topics` are those of the messages of the log in which its fields are named."""
    return rule.renamed(lambda name: in_words(name, topics)).text()


def moments_of(
    latest: LatestFields, messages: Iterable[Message], topics: Sequence[str], *, registry: TypeRegistry
) -> Iterator[list[Moment]]:
    """Yield the messages of a log by which a rule can be judged, some thousand at once."""
    rows: list[Moment] = []
    for place, message in enumerate(messages):
        values = latest.take(message)
        if values is None:
            continue
        last = not topics or registry.topic(message.key) == topics[-1]
        rows.append(Moment(place, message.time, values, last))
        if len(rows) == 4096:  # enough that numpy's overhead does not count, and little memory
            yield rows
            rows = []
    yield rows


def _judge_alike(rule: Rule, names: Sequence[str], rows: Sequence[Moment], found: Prediction) -> list[Moment]:
    """Count rows in which the same fields are known; return those at which the rule holds."""
    columns = {name: column_of([row.values[name] for row in rows]) for name in names}
    sure, possible = np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
    for numbers in alike(columns, len(rows)):
        part = {name: column[numbers] for name, column in columns.items()}
        sure[numbers], possible[numbers] = rule.judge(part, len(numbers))
    last = np.array([row.last for row in rows])
    told = last | (len(names) == len(rule.variables))
    found.judged += int(np.count_nonzero(sure | (~possible & told)))
    found.unknown += int(np.count_nonzero(possible & ~sure & last))
    found.fails += int(np.count_nonzero(sure))
    return [rows[number] for number in np.flatnonzero(sure).tolist()]


def alike(columns: Mapping[str, NDArray[Any]], count: int) -> Iterator[NDArray[np.intp]]:
    """Yield groups of row numbers within which each column holds only numbers, or none.

    A column that holds a text counts as texts in all of its rows.
    """
    mixed = [column for column in columns.values() if column.dtype == np.object_]
    if not mixed:
        yield np.arange(count)
        return
    numbers = np.array([[isinstance(value, int | float) for value in column.tolist()] for column in mixed])
    for kind in np.unique(numbers, axis=1).T:
        yield np.flatnonzero((numbers == kind[:, np.newaxis]).all(axis=0))


def column_of(values: Sequence[Scalar]) -> NDArray[Any]:
    """Return values as an array of floats if all are floats, else of objects, so that integers stay exact."""
    if all(type(value) is float for value in values):
        return np.array(values, dtype=np.float64)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column
