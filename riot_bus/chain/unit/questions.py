"""Questions to a unit, as the steps at unit level share them: the minimal log, values for its fields, fresh trials."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path

from riot_bus.campaign.confirm import CONFIRMATIONS
from riot_bus.chain.base.logs import FailingLog, NamedField, NamedFields, nominal_values
from riot_bus.chain.base.workspace import StepRun, Workspace
from riot_bus.findings.records import CertificateRecord, FieldsRecord, FindingRecord, MinimalRecord, RuleRecord, Value
from riot_bus.generalize.oracle import BudgetSpentError, Trials, scalar_key
from riot_bus.generalize.rule import Rule
from riot_bus.inject.dictionary import Dictionary, load_dictionary
from riot_bus.statistics.noise import Noise
from riot_bus.types.capabilities import suggested_values
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.elements import Setting
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Ask, Outcome, Runner, TestCase

_OBSERVED = 8
FEWEST, _MOST_PASSED, _MOST, _SPREAD = 12, 40, 120, 0.15
"""Fewest trials to measure a rate, most if none fails, most, and the uncertainty allowed, as a share of the rate.
Inputs are taken for harmless after so few trials that mistaking a rate of 0.3 for 0.6 made a third of the answers
wrong. If it may be 0.1, each takes twice as many as at a known 0.3, which costs far more than these."""
_MOST_TRIALS = 10_000
"""Far more than a rule needs at a failure rate of 0.2; each trial takes at least a tenth of a second."""


def json_value(value: Scalar) -> Value:
    """Return a value in a form that JSON can hold."""
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
    return tuple({scalar_key(value): value for value in (*some, *entries)}.values())


def observed_in(
    log: Sequence[Message], fields: Iterable[NamedField], *, registry: TypeRegistry, at_most: int = 2000
) -> dict[str, list[Scalar]]:
    """Return the values that fields of a short log took in another log, evenly thinned out, by name."""
    named = list(fields)
    paths: dict[str, set[str]] = {}
    for field in named:
        paths.setdefault(field.topic, set()).add(field.leaf.path)
    values = nominal_values(log, paths, registry=registry, at_most=at_most)
    return {field.name: values[f"{field.topic}:{field.leaf.path}"] for field in named}


def named_fields(folder: Path) -> list[str]:
    """Return the names of a finding's relevant fields, and of the variables of its rule if it has one."""
    record = RuleRecord.find(folder)
    variables = Rule.from_json(record.rule).variables if record else ()
    return [*(one.name for one in FieldsRecord.load(folder).fields), *variables]


def noise_of(finding: FindingRecord, minimal: MinimalRecord | None = None) -> Noise:
    """Return what is known about the rate of a failure, and its rate without the cause.

    Args:
        finding: The finding of a campaign. Its case may have many causes of the failure, so it may fail more often.
        minimal: Results of trials of the minimal log, which then alone count for the rate.
    """
    return Noise.after(*_counts(finding, minimal), nominal_total=nominal_passes(finding))


def _counts(finding: FindingRecord, minimal: MinimalRecord | None) -> tuple[int, int]:
    """Return the failed and all trials that tell the rate of a failure."""
    if minimal and minimal.failed[1]:
        return minimal.failed
    return (finding.rate.count, finding.rate.total) if finding.rate else (0, 0)


def measured_rate(
    ask: Callable[[], Sequence[bool]], *, failed: int = 0, total: int = 0, most: int = _MOST
) -> tuple[int, int]:
    """Return the failed and all trials of a case that fails, once they tell its rate well enough.

    Args:
        most: Maximum number of further trials; fewer are made if none fails.
    """
    known, enough = total, None
    while total - known < min(most, _MOST if failed else _MOST_PASSED):
        if failed and total >= FEWEST:
            # To look again after each trial would stop at low rates too often, and the interval would be too narrow.
            enough = enough or math.ceil((1 - Noise.after(failed, total).rate) / _SPREAD**2)
            if failed >= enough:
                break
        answers = ask()
        failed, total = failed + sum(answers), total + len(answers)
    return failed, total


def nominal_passes(finding: FindingRecord) -> int:
    """Return how many nominal trials passed, 0 if any failed as the finding does."""
    nominal = finding.nominal
    return nominal.total if nominal is not None and nominal.count == 0 else 0


def unit_case(
    workspace: Workspace, finding: FindingRecord, messages: Sequence[Message], *, unprobed: bool = False
) -> TestCase:
    """Return a test case that plays messages to the unit of a finding, perhaps without a probe after them."""
    paced = workspace.context.file.unit[finding.unit].rate > 0
    return TestCase(tuple(messages), seed=workspace.seed, ordered=finding.ordered, paced=paced, unprobed=unprobed)


class FreshCases:
    """A runner that gives each case a fresh trial each time: the store knows the first, second, ... of each.

    Args:
        after: Number of first trials of each case to skip, since they have another purpose.
    """

    def __init__(self, runner: Runner, *, after: int = 0) -> None:
        self._runner = runner
        self._after = after
        self._asked: Counter[str] = Counter()

    @property
    def parallelism(self) -> int:
        """How many trials run at once."""
        return self._runner.parallelism

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Return the outcomes of fresh trials, even of identical cases."""
        numbered = []
        for case in cases:
            digest = case.digest()
            # A first trial is numbered 0 as everywhere; 1 to 20 are the trials that confirmed the finding.
            number = self._after + self._asked[digest]
            numbered.append(replace(case, again=number + CONFIRMATIONS if number else 0))
            self._asked[digest] += 1
        return self._runner.run(numbered)

    def failures(self, cases: Sequence[TestCase], signature: str) -> list[bool]:
        """Return for each case whether a fresh trial fails with a signature."""
        return [outcome.failed_as(signature) for outcome in self.run(cases)]


class UnitQuestions:
    """Asks a unit whether it fails when fields of its minimal log have other values.

    Attributes:
        fields: The minimal log, by field.
    """

    def __init__(self, step: StepRun, folder: Path) -> None:
        self._workspace = step.workspace
        self.finding = FindingRecord.load(folder)
        registry = step.workspace.context.registry
        self.fields = NamedFields(FailingLog.load(folder / "minimal.mcap", registry=registry), registry=registry)
        self.dictionary = dictionary_of(step.workspace, self.finding.unit)
        self.runner = step.unit_runner(self.finding.unit)
        cases = FreshCases(self.runner)
        minimal = MinimalRecord.find(folder)
        self._unprobed = minimal is not None and minimal.unprobed
        self.noise = noise_of(self.finding, minimal)
        self._known = _counts(self.finding, minimal)
        self._trials: Trials[TestCase] = Trials(
            lambda asked: cases.failures(asked, self.finding.signature),
            key=TestCase.digest,
            noise=self.noise,
            budget=_MOST_TRIALS,
            parallelism=self.runner.parallelism,
        )

    def measure(self, certificates: Iterable[CertificateRecord]) -> None:
        """Learn the failure rate from trials of certificates, too, and if any has passed, from as many as it takes."""
        failed, total = self._known
        for one in certificates:
            failed, total = failed + one.confirmed_failing, total + one.repeats
        if failed < total:
            fresh = self.fresh(after=2000)  # not those by which earlier steps chose the minimal log
            same: list[dict[str, Setting]] = [{}] * self.runner.parallelism
            failed, total = measured_rate(lambda: fresh(same), failed=failed, total=total)
        self.noise = Noise.after(failed, total, nominal_total=nominal_passes(self.finding))
        self._trials.noise = self.noise

    def within(self, fields: NamedFields) -> UnitQuestions:
        """Return the same questions over another log."""
        other = copy(self)
        other.fields = fields
        return other

    def nominal_log(self) -> tuple[Message, ...]:
        """Return the inputs of the unit in the nominal log."""
        return self._workspace.unit_log(self.finding.unit)

    def nominal(self, fields: Iterable[NamedField], *, at_most: int = 2000) -> dict[str, list[Scalar]]:
        """Return the values that fields of the minimal log took in the nominal log, evenly thinned out, by name."""
        return observed_in(self.nominal_log(), fields, registry=self._workspace.context.registry, at_most=at_most)

    def case(self, values: Mapping[str, Setting]) -> TestCase:
        """Return a case of the minimal log with values set by name, played in order if the log has orders."""
        case = self.case_of(self.fields.with_values(values))
        return replace(case, ordered=case.ordered or bool(self.fields.orders))

    def case_of(self, messages: Sequence[Message]) -> TestCase:
        """Return a test case that plays messages to the unit."""
        return unit_case(self._workspace, self.finding, messages, unprobed=self._unprobed)

    def fresh(self, *, after: int = 0) -> Ask[Mapping[str, Setting]]:
        """Return a function that answers by a fresh trial each time; see `FreshCases` for `after`."""
        cases = FreshCases(self.runner, after=after)
        return lambda asked: cases.failures([self.case(values) for values in asked], self.finding.signature)

    def decide(
        self, cases: Sequence[TestCase], *, doubt: float = 0.05, priors: Sequence[float] | None = None
    ) -> list[bool]:
        """Return for each case whether it triggers the failure, from as many fresh trials as that takes.

        One trial decides unless the failure was seen to occur only sometimes. What is known about a case counts.

        Args:
            priors: Probability of each case to trigger the failure before any trial; None if nothing is known.

        Raises:
            InconclusiveError: The maximum number of trials is spent.
        """
        try:
            return self._trials.decide(cases, doubt=doubt, doing="deciding", priors=priors)
        except BudgetSpentError:
            raise InconclusiveError(
                f"{_MOST_TRIALS} trials have not told when it fails: it comes too seldom",
                hint=f"its rate is about {self.noise.rate:.2f}; what makes it come more often?",
            ) from None

    def ask(self, questions: Sequence[Mapping[str, Setting]], priors: Sequence[float] | None = None) -> list[bool]:
        """Return for each assignment of values whether it triggers the failure; see `decide`."""
        return self.decide([self.case(values) for values in questions], priors=priors)
