"""Prediction of a rule for a whole log: the messages at which the unit would fail."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from riot_bus.chain.questions import json_value
from riot_bus.chain.testcases import injection_of
from riot_bus.findings.records import FindingRecord, MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.inject.apply import inject_log
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.reader import LogReader
from riot_bus.sut.context import open_system
from riot_bus.types.latest import LatestFields, in_words
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from riot_bus.chain.workspace import StepRun
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["Moment", "Prediction", "alike", "column_of", "explained", "predict", "predict_log"]

_TOLD = 20
_RELIABLE = 0.95
_MOST_MESSAGES = 300_000
"""Most messages of trials that a rule is checked against, in all: about half a minute."""

_ROWS = 4096
"""Rows that are judged at once: enough that numpy's overhead does not count, and little memory."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A message at which a rule holds: its place in the log, when it was sent (ns), and the fields of the rule."""

    place: int
    time: int
    values: Mapping[str, Scalar]


@dataclass(slots=True)
class Prediction:
    """The prediction of a rule for a log.

    Attributes:
        judged: Number of messages at which all fields of the rule were known.
        unknown: Number of messages of the last of the rule's topics at which a field was not known.
        fails: Number of judged messages at which the rule holds.
        moments: The first of these messages.
        begin: When the first message of the log was sent (ns).
        rule: The rule as text.
        topics: Topic of each message of the log in which the rule's fields are named.
    """

    rule: str = ""
    topics: Sequence[str] = ()
    begin: int = 0
    judged: int = 0
    unknown: int = 0
    fails: int = 0
    moments: list[Moment] = field(default_factory=list)

    def lines(self) -> list[str]:
        """Return the prediction as lines of text."""
        of = f"{counted(self.judged, 'message')} of its topics"
        first = (
            f"{'would fail' if self.fails else 'would not fail'}: the rule {self.rule} holds at {self.fails} of {of}"
        )
        found = [first + (f"; {self.unknown} lack a field of it" if self.unknown else "")]
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
        figures = {"judged": self.judged, "unknown": self.unknown, "fails": self.fails}
        return {"rule": self.rule, **figures, "moments": moments}


def predict_log(path: Path, folder: Path) -> Prediction:
    """Return the prediction of a finding's rule for a log.

    Args:
        path: Path of the log, which may be larger than memory.
        folder: Folder of the finding.

    Raises:
        ConfigError: There is no such log, or the finding has no rule.
        InconclusiveError: The fields of the rule are never known together in the log.
    """
    record = RuleRecord.load(folder)
    registry = open_system(Path(FindingRecord.load(folder).system_file)).registry
    with LogReader(path) as reader:
        learn_types(reader, registry)
        topics = record.topics or MinimalRecord.load(folder).topics
        found = predict(Rule.from_json(record.rule), topics, bus_messages(reader, registry), registry=registry)
    if not found.judged:
        raise InconclusiveError(
            f"the fields of the rule {record.text} are never known together",
            where=str(path),
            hint=f"{counted(found.unknown, 'message')} of its topics came; `riot info` says what the log holds",
        )
    return found


class Explained(NamedTuple):
    """Comparison of a rule with earlier trials.

    Attributes:
        trials: Number of trials compared.
        wrong: Trials that the rule predicts wrongly: what was injected, and whether they failed.
        holds: If the failure occurs only sometimes: the failed and all trials in which the rule holds.
    """

    trials: int
    wrong: list[tuple[list[dict[str, Any]], bool]]
    holds: tuple[int, int]


def explained(record: RuleRecord, step: StepRun, unit: str, signature: str, *, rate: float = 1.0) -> Explained:
    """Compare a rule with the trials that campaigns have run on the nominal log already; nothing is run.

    Trials that failed in another way do not count, since they do not show whether this failure would have occurred.
    Nor do trials with this failure where the rule holds nowhere but some of its fields were unknown, such as before the
    first message of a topic; nor passing ones where the rule holds, if the failure occurs only sometimes: `holds`
    counts those.

    Args:
        record: The rule.
        step: The running step.
        unit: The unit.
        signature: Signature of the failure.
        rate: Rate at which the failure occurs when triggered.

    """
    rule, registry = Rule.from_json(record.rule), step.workspace.context.registry
    log = step.workspace.unit_log(unit)
    told = [
        (rows, seed, outcome.failed_as(signature))
        for rows, seed, outcome in step.tried(unit)
        if outcome.verdict is Verdict.PASS or outcome.failed_as(signature)
    ]
    told = told[:: max(1, -(-len(told) * len(log) // _MOST_MESSAGES))]
    wrong: list[tuple[list[dict[str, Any]], bool]] = []
    count, holds = 0, Counter[bool]()
    for rows, seed, failed in told:
        injections = [injection_of(row, "trials") for row in rows]
        messages, _ = inject_log(log, injections, registry=registry, seed=seed)
        found = predict(rule, record.topics, messages, registry=registry, at_most=1)
        if found.fails and rate < _RELIABLE:
            holds[failed] += 1
        if (failed and not found.fails and found.unknown) or (found.fails and not failed and rate < _RELIABLE):
            continue
        count += 1
        if bool(found.fails) != failed:
            wrong.append((rows, failed))
    return Explained(count, wrong, (holds[True], holds.total()))


def predict(
    rule: Rule, topics: Sequence[str], messages: Iterable[Message], *, registry: TypeRegistry, at_most: int = 100
) -> Prediction:
    """Judge each message of a log by the latest messages of the rule's topics.

    Args:
        rule: The rule.
        topics: Topic of each message of the short log in which the rule's fields are named.
        messages: The log, in order; it may be larger than memory.
        registry: The registry of topics and types.
        at_most: Maximum number of moments to keep.

    Raises:
        ConfigError: A variable of the rule is not a field.
    """
    latest = LatestFields(rule.variables, topics, registry=registry)
    found = Prediction(rule.renamed(lambda name: in_words(name, topics)).text(), topics)
    rows: list[Moment] = []
    for place, message in enumerate(messages):
        found.begin = found.begin if place else message.time
        values = latest.take(message)
        if values is None:
            continue
        if len(values) < len(rule.variables):
            found.unknown += not topics or registry.topic(message.key) == topics[-1]
            continue
        rows.append(Moment(place, message.time, values))
        if len(rows) == _ROWS:
            _judge(rule, rows, found, at_most)
            rows.clear()
    _judge(rule, rows, found, at_most)
    return found


def _judge(rule: Rule, rows: Sequence[Moment], found: Prediction, at_most: int) -> None:
    columns = {name: column_of([row.values[name] for row in rows]) for name in rule.variables}
    failing: list[int] = []
    for numbers in alike(columns, len(rows)):
        held = rule.predict({name: column[numbers] for name, column in columns.items()})
        failing += numbers[held].tolist()
    found.judged += len(rows)
    found.fails += len(failing)
    found.moments += [rows[number] for number in sorted(failing)][: at_most - len(found.moments)]


def alike(columns: Mapping[str, NDArray[Any]], count: int) -> Iterator[NDArray[np.intp]]:
    """Yield groups of row numbers within which each column holds only numbers, or none.

    A column that holds a text counts as texts in all of its rows.

    Args:
        columns: One array of equal length per variable.
        count: Number of rows.
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
