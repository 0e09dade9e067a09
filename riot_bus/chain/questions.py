"""What the steps at unit level share: the fields of the minimal log, the values for them, and questions to the unit."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, TypeVar

from riot_bus.chain.logs import FailingLog, NamedField, NamedFields, nominal_values
from riot_bus.findings.records import FindingRecord, Value
from riot_bus.generalize.oracle import same_scalar
from riot_bus.inject.dictionary import Dictionary, load_dictionary
from riot_bus.types.capabilities import suggested_values
from riot_bus.vocabulary.trial import Outcome, Scalar, TestCase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import StepRun, Workspace
    from riot_bus.vocabulary.message import Message

__all__ = ["UnitQuestions", "dictionary_of", "draws_for", "json_value"]

FoundT = TypeVar("FoundT")

_OBSERVED = 8


def json_value(value: Scalar) -> Value:
    """Return a value as JSON can hold it."""
    return value.hex() if isinstance(value, bytes) else value


def dictionary_of(workspace: Workspace, unit: str) -> Dictionary:
    """Return the dictionaries that apply to a unit: the installed ones and those that riot.toml names."""
    file = workspace.context.file
    return load_dictionary([file.root / name for name in file.unit[unit].dictionaries])


def draws_for(field: NamedField, dictionary: Dictionary, observed: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Return replacement values for a field: exceptional ones, and some that it had in the nominal log."""
    told = suggested_values(field.kind, field.payload, field.leaf.path)
    known = dictionary.values_for(field.leaf.type, f"{field.topic}:{field.leaf.path}", told=told)
    entries = [entry.value for entry in known]
    some = list(observed[:: max(1, len(observed) // _OBSERVED)])[:_OBSERVED]
    values: list[Scalar] = []
    for value in (*some, *entries):
        if not any(same_scalar(value, other) for other in values):
            values.append(value)
    return tuple(values)


class UnitQuestions:
    """Asks a unit whether it fails when fields of its minimal log have other values.

    Args:
        step: The running step.
        folder: The finding.

    Attributes:
        finding: The failure that is asked for.
        fields: The minimal log, by field.
        dictionary: Exceptional values for the unit.
        runner: Executes the trials.
    """

    def __init__(self, step: StepRun, folder: Path) -> None:
        self._workspace = step.workspace
        self.finding = FindingRecord.load(folder)
        registry = step.workspace.context.registry
        self.fields = NamedFields(FailingLog.load(folder / "minimal.mcap", registry=registry), registry=registry)
        self.dictionary = dictionary_of(step.workspace, self.finding.unit)
        self.runner = step.unit_runner(self.finding.unit)
        self._corrected: dict[str, bool] = {}

    def within(self, fields: NamedFields) -> UnitQuestions:
        """Return the same questions over another log."""
        other = copy(self)
        other.fields, other._corrected = fields, {}
        return other

    def nominal_log(self) -> tuple[Message, ...]:
        """Return the inputs of the unit in the nominal log."""
        return self._workspace.unit_log(self.finding.unit)

    def nominal(self, fields: Iterable[NamedField], *, at_most: int = 2000) -> dict[str, list[Scalar]]:
        """Return the values that fields of the minimal log took in the nominal log, evenly thinned out, by name."""
        named = list(fields)
        paths: dict[str, set[str]] = {}
        for field in named:
            paths.setdefault(field.topic, set()).add(field.leaf.path)
        log = self.nominal_log()
        values = nominal_values(log, paths, registry=self._workspace.context.registry, at_most=at_most)
        return {field.name: values[f"{field.topic}:{field.leaf.path}"] for field in named}

    def case(self, values: Mapping[str, Scalar], *, again: int = 0) -> TestCase:
        """Return the minimal log with values set by name; `again` numbers its repetitions with fresh processes."""
        return TestCase(
            self.fields.with_values(values), seed=self._workspace.seed + again, ordered=self.finding.ordered
        )

    def repeat(self, questions: Sequence[Mapping[str, Scalar]], numbers: range) -> list[Sequence[Outcome]]:
        """Return for each question the outcomes of its repetitions with these numbers."""
        outcomes = self.runner.run([self.case(values, again=again) for values in questions for again in numbers])
        return [outcomes[start : start + len(numbers)] for start in range(0, len(outcomes), len(numbers))]

    def failed(self, outcome: Outcome) -> bool:
        """Return whether an outcome is the failure that is asked for."""
        return outcome.failed_as(self.finding.signature)

    def ask(self, questions: Sequence[Mapping[str, Scalar]]) -> list[bool]:
        """Return for each assignment of values whether the unit fails; answers that were corrected stay so."""
        cases = [self.case(values) for values in questions]
        outcomes = self.runner.run(cases)
        return [
            self._corrected.get(case.digest(), self.failed(outcome))
            for case, outcome in zip(cases, outcomes, strict=True)
        ]

    def settle(
        self,
        search: Callable[[], FoundT],
        contradicted: Callable[[FoundT], Sequence[tuple[Mapping[str, Scalar], bool]]],
        *,
        rounds: int,
    ) -> FoundT:
        """Search; correct the answers that repetitions contradict, and search again (all others come from the store).

        Args:
            search: Finds something by `ask`.
            contradicted: Says which answers behind it are wrong: the values, and the answer that is right.
            rounds: At most so many searches; what the last one finds stands.
        """
        for _ in range(rounds):
            found = search()
            wrong = contradicted(found)
            if not wrong:
                break
            self._corrected.update({self.case(values).digest(): answer for values, answer in wrong})
        return found
