"""Runs of the whole system with external fields driven, and their effects on internal fields (RIOT II-C)."""

from __future__ import annotations

import zlib
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import chain
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riot_bus.backchain.permeability import FieldDrive, PermeabilityEdge, PermeabilityResult, Run, Skipped, analyse
from riot_bus.chain.base.external import ExternalField
from riot_bus.chain.base.workspace import StepRun
from riot_bus.findings.permeability import Design, EdgeRecord
from riot_bus.inject.apply import inject_log
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.injection import PARAMETERS, Injection, Signal
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Progress, Runner, Series, TestCase

_HOLD = 5
"""Samples of the slowest internal field during which a value is held."""
_DRAWS = 399
_IS = "\0"
"""Separator between a field and one of its texts; no name contains it."""
_SUMMARIES: dict[str, Callable[[NDArray[np.float64]], Any]] = {
    "mean": np.mean,
    "spread": np.std,
    "last": itemgetter(-1),
}
"""Summaries of an internal field over a whole run."""


_SAMPLES, _FEWER_DRAWS = 200, 199
"""Samples of a run, and draws that still show a chance of 1 %, for intermediate fields: they cost less than others."""

_ABSENT = "no message of its topic came in these runs"
_UNCHANGED = "no message that came in these runs could be changed in it"
_RARE = "messages of its topic came in too few of these runs"
_REFUSED = "its node refused nearly all values that were tried"
_STILL = "inner fields had far fewer values than in nominal runs where each external field had one value in a run"

Perturbed = tuple[Mapping[ExternalField, Signal], "Outcome"]
"""Signals of the external fields in a run, and its outcome."""


_Drawn = Mapping[ExternalField, tuple[Signal, Callable[[float], float]]]
"""A signal with one value for each run, and a function from that to the field's value."""


class Usual(NamedTuple):
    """Behaviour of an internal field in nominal runs.

    Attributes:
        rate: Its messages per second in the nominal log.
        moves: Whether it has more than one value.
    """

    rate: float
    values: float
    moves: bool


class ConstantRuns(NamedTuple):
    """Results of runs in which each external field is constant."""

    edges: list[EdgeRecord]
    runs: int
    untold: dict[str, str]
    intermediate: list[EdgeRecord]


@dataclass(frozen=True, slots=True)
class DrivenRuns:
    """Runs of the whole system in which external fields are driven.

    Attributes:
        runner: Runner that observes the internal fields, and the times of the external topics.
        failures: Failed runs by signature; a run that fails with `signature` counts for it alone.
        failing: Values by field, as a search sets them, of runs with constant fields that failed with `signature`.
    """

    step: StepRun
    runner: Runner
    driving: tuple[Message, ...]
    internals: Sequence[str]
    usual: Mapping[str, Usual]
    speed: float = 1.0
    signature: str = ""
    intermediates: Sequence[str] = ()
    changed: set[str] = field(default_factory=set)
    failures: Counter[str] = field(default_factory=Counter)
    failing: list[dict[str, float]] = field(default_factory=list)

    def within(self, fields: Sequence[ExternalField], numbers: range) -> list[Perturbed]:
        """Return runs in which all fields are driven, each by its own signal in each run."""
        return self._driven([fields] * len(numbers), numbers)

    def _driven(self, groups: Sequence[Sequence[ExternalField]], numbers: range) -> list[Perturbed]:
        """Return a run for each group of fields, in which these are driven."""
        plans = [
            {field: self._signal(field, run) for field in group} for group, run in zip(groups, numbers, strict=True)
        ]
        cases = [
            self._case((Injection(field.topic, field.path, signal) for field, signal in plan.items()), run)
            for plan, run in zip(plans, numbers, strict=True)
        ]
        doing = f"{counted(max(map(len, groups)), 'external field')} perturbed at once"
        return list(zip(plans, self._carried_out(plans, cases, doing, before=numbers.start), strict=True))

    def _carried_out(
        self, plans: Sequence[Iterable[ExternalField]], cases: Sequence[TestCase], doing: str, *, before: int = 0
    ) -> list[Outcome]:
        """Run cases, as many at once as the runner can, and note which fields they changed and how they failed.

        Args:
            plans: For each case the fields that it sets, in the order of its injections.
        """
        outcomes: list[Outcome] = []
        for start in range(0, len(cases), self.runner.parallelism):
            outcomes += self.runner.run(cases[start : start + self.runner.parallelism])
            for number in range(start, len(outcomes)):
                self._note(plans[number], cases[number], outcomes[number])
            self.step.progress(before + len(outcomes), before + len(cases), doing)
        return outcomes

    def _note(self, plan: Iterable[ExternalField], case: TestCase, outcome: Outcome) -> None:
        own = outcome.failed_as(self.signature)
        self.failures.update({self.signature} if own else {each.signature for each in outcome.violations})
        fields = [one for one in plan if not one.parameter]
        if case.messages and "delivered" not in outcome.statistics:
            self.changed.update(changed_in_log(fields, case, self.step.workspace.context.registry, self.changed))
        else:  # runs of earlier versions do not say what was changed
            counts = outcome.statistics.get("delivered") or [_times(outcome, one) for one in fields]
            self.changed.update(one.name for one, count in zip(fields, counts, strict=True) if count)

    def why_undriven(self, one: ExternalField, outcomes: Sequence[Outcome], *, least: int = 1) -> str:
        """Return why runs did not set a field, so that they say nothing about it; empty if they did."""
        if one.parameter:
            refused = sum(one.path in outcome.statistics.get("refused", {}) for outcome in outcomes)
            return _REFUSED if refused and len(outcomes) - refused < least else ""
        came = sum(_times(outcome, one) > 0 for outcome in outcomes)
        if one.name not in self.changed:
            return _UNCHANGED if came else _ABSENT
        return _RARE if came < least and not one.timing else ""

    def between(
        self, fields: Sequence[ExternalField], numbers: range, *, alpha: float, design: Design = "between runs"
    ) -> ConstantRuns:
        """Return how constant external fields affect mean, spread and last value of internal ones over runs.

        Args:
            numbers: Numbers of the runs; as many more follow if something almost reaches an otherwise unreached field.
            alpha: Accepted share of false discoveries for each internal field in each of the two tests.
            design: Design of the runs; `beyond nominal` spreads values over all that may be tried, on search scale.
        """
        drawn = {field: self._drawn(field, beyond=design == "beyond nominal") for field in fields}
        outcomes = self._constant(drawn, 0, numbers)
        edges, untold = self._followed(drawn, outcomes, alpha=alpha, design=design)
        reached = {edge.internal for edge in edges if edge.permeable}
        if any(edge.p_value <= 0.05 for edge in edges if edge.internal not in reached):
            outcomes += self._constant(drawn, len(numbers), range(numbers.stop, numbers.stop + len(numbers)))
            edges, untold = self._followed(drawn, outcomes, alpha=alpha, design=design)
        intermediate, _ = self._followed(drawn, outcomes, alpha=alpha, design=design, names=self.intermediates)
        count = len(outcomes)
        if sum(self.freezes(outcome, constant=True) for outcome in outcomes) > count // 2:
            ((_, idle),) = self._driven([[]], numbers[:1])
            count += 1
            if not self.freezes(idle, constant=True):
                edges = [edge for edge in edges if edge.permeable]
                intermediate = [edge for edge in intermediate if edge.permeable]
                told = {edge.external for edge in edges}
                untold |= {one.name: _STILL for one in fields if one.name not in told}
        return ConstantRuns(edges, count, untold, intermediate)

    def _constant(self, drawn: _Drawn, first: int, numbers: range) -> list[Outcome]:
        """Return outcomes of runs in which each field has the next value drawn for it, starting with number `first`."""
        points = [
            {field: value(signal.value(at)) for field, (signal, value) in drawn.items()}
            for at in range(first, first + len(numbers))
        ]
        cases = [
            self._case((field.injection(value, speed=self.speed) for field, value in point.items()), number)
            for point, number in zip(points, numbers, strict=True)
        ]
        doing = f"{counted(len(drawn), 'external field')} constant in each run"
        outcomes = self._carried_out([drawn] * len(cases), cases, doing)
        self.failing.extend(
            {field.name: value for field, value in point.items()}
            for point, outcome in zip(points, outcomes, strict=True)
            if outcome.failed_as(self.signature)
        )
        return outcomes

    def _followed(
        self,
        drawn: _Drawn,
        outcomes: Sequence[Outcome],
        *,
        alpha: float,
        design: Design,
        names: Sequence[str] | None = None,
    ) -> tuple[list[EdgeRecord], dict[str, str]]:
        """Return how internal fields, or others, depend on the values that external ones had in each run.

        Also return the external fields that could not be judged, and why.
        """
        count = range(len(outcomes))
        untold = {one.name: why for one in drawn if (why := self.why_undriven(one, outcomes, least=8))}
        inputs = {
            field.name: FieldDrive(Series(tuple(map(float, count)), tuple(map(signal.value, count))), signal)
            for field, (signal, _) in drawn.items()
            if field.name not in untold
        }
        told = as_numbers(outcomes, self.internals if names is None else names)
        found: list[EdgeRecord] = []
        for summary in _SUMMARIES.values():
            outputs = {}
            for name in told[0] if told else ():
                seen = [(float(run), np.asarray(told[run][name].values, dtype=np.float64)) for run in count]
                kept = [(run, float(summary(values))) for run, values in seen if len(values)]
                outputs[name] = Series(tuple(run for run, _ in kept), tuple(value for _, value in kept))
            # each summary is one more chance of a false discovery
            result = analysed(
                [Run(inputs, outputs)], alpha=alpha / len(_SUMMARIES), seed=self.step.workspace.seed, lags=1
            )
            found += [edge_record(edge, design) for edge in result.edges]
            untold = skip_reasons(result) | untold
        told_of = {edge.external for edge in found}
        return list(strongest(found).values()), {name: why for name, why in untold.items() if name not in told_of}

    def freezes(self, outcome: Outcome, *, constant: bool = False) -> bool:
        """Return whether an internal field has far fewer values than in nominal runs, or just one instead of several.

        A failed run does not count as frozen: a crashed component publishes nothing more, but it refused no input.
        """
        if outcome.violations:
            return False
        for name, usual in self.usual.items():
            values = outcome.observed[name].values
            if len(values) < usual.values / 2 or (usual.moves and not constant and len(set(values)) < 2):
                return True
        return False

    def freezing(
        self, fields: Sequence[ExternalField], numbers: range
    ) -> tuple[list[ExternalField], list[ExternalField], int]:
        """Find the external fields that freeze internal ones, for example because a message is refused.

        Returns:
            These fields, those that the runs did not suffice to tell apart, and the number of runs used. There are no
            fields of either kind if internal ones also freeze when nothing is driven.
        """
        ((_, idle),) = self._driven([[]], numbers[:1])
        if self.freezes(idle):
            return [], [], 1
        by_topic: dict[str, list[ExternalField]] = {}
        for one in fields:
            by_topic.setdefault(one.topic, []).append(one)
        untested, found, spent = deque(by_topic.values()), list[ExternalField](), 1
        while untested and spent < len(numbers):
            count = min(self.runner.parallelism, len(untested), len(numbers) - spent)
            groups = [untested.popleft() for _ in range(count)]
            outcomes = self._driven(groups, numbers[spent : spent + count])
            spent += count
            for group, (_, outcome) in zip(groups, outcomes, strict=True):
                if self.freezes(outcome):
                    half = len(group) // 2
                    found += group if not half else []
                    untested.extend([group[:half], group[half:]] if half else [])
        return found, list(chain.from_iterable(untested)), spent

    def runs(self, some: Sequence[Perturbed], *, intermediate: bool = False) -> list[Run]:
        """Return runs in which fields were driven, in the form that the analysis takes.

        Args:
            intermediate: Whether outputs are the intermediate fields, with fewer samples, instead of the internal ones.
        """
        outputs = as_numbers([outcome for _, outcome in some], self.intermediates if intermediate else self.internals)
        if intermediate:
            outputs = [{name: _thinned(series) for name, series in one.items()} for one in outputs]

        def drive(times: Sequence[float], signal: Signal) -> FieldDrive:
            return FieldDrive(Series(tuple(times), tuple(map(signal.value, range(len(times))))), signal)

        inputs = (
            {
                field.name: drive(outcome.observed[field.topic].times, signal)
                for field, signal in plan.items()
                if field.name in self.changed
            }
            for plan, outcome in some
        )
        return list(map(Run, inputs, outputs))

    def analysed(self, some: Sequence[Perturbed], *, alpha: float, intermediate: bool = False) -> PermeabilityResult:
        """Return how internal fields, or the intermediate ones, follow the fields that were driven in some runs."""
        runs, seed = self.runs(some, intermediate=intermediate), self.step.workspace.seed
        return analysed(runs, alpha=alpha, seed=seed, intermediate=intermediate, progress=self.step.progress)

    def _case(self, injections: Iterable[Injection], number: int) -> TestCase:
        return TestCase(self.driving, tuple(injections), seed=self.step.workspace.seed + number)

    def _signal(self, field: ExternalField, run: int) -> Signal:
        slowest = min((each.rate for each in self.usual.values()), default=0.0)
        hold = max(1, round(_HOLD * field.rate / slowest)) if slowest else _HOLD
        return field.signal(self._seed(field, run), hold=hold)

    def _drawn(self, field: ExternalField, *, beyond: bool) -> tuple[Signal, Callable[[float], float]]:
        """Return a signal with one value for each run, and a function from that to the field's value."""
        if not beyond or field.choices:
            return field.signal(self._seed(field, -1), hold=1), float
        search = field.search_field()
        low, high = search.encode(search.low), search.encode(search.high)
        return Signal((low + high) / 2, (high - low) / 2, 1, self._seed(field, -2)), search.decode

    def _seed(self, field: ExternalField, run: int) -> int:
        return zlib.crc32(f"{self.step.workspace.seed}:{run}:{field.name}".encode())


def changed_in_log(
    fields: Sequence[ExternalField], case: TestCase, registry: TypeRegistry, known: Collection[str] = ()
) -> set[str]:
    """Return the names of the fields that a case sets in some message of the log that it plays."""
    injections = [each for each in case.injections if each.topic != PARAMETERS]
    pairs = [(one, each) for one, each in zip(fields, injections, strict=True) if one.name not in known]
    topics = {one.topic for one, _ in pairs}
    log = [message for message in case.messages if registry.topic(message.key) in topics]
    reached: list[list[int]] = []
    inject_log(log, [each for _, each in pairs], registry=registry, seed=case.seed, reached=reached)
    return {one.name for (one, _), places in zip(pairs, reached, strict=True) if places}


def analysed(
    runs: Sequence[Run],
    *,
    alpha: float,
    seed: int,
    lags: int = 12,
    intermediate: bool = False,
    progress: Progress | None = None,
) -> PermeabilityResult:
    """Return the result of `analyse`, with one error rate for all numbers made from a field."""
    draws = _FEWER_DRAWS if intermediate else _DRAWS
    groups: dict[str, set[str]] = {}
    for name in {name for run in runs for name in run.outputs}:
        groups.setdefault(internal_of(name), set()).add(name)
    edges: list[PermeabilityEdge] = []
    skipped: list[Skipped] = []
    total, before = sum(map(len, groups.values())), 0

    def told(done: int, _: int | None, doing: str) -> None:
        if progress is not None:
            progress(before + done, total, doing)

    for _, names in sorted(groups.items()):
        some = [Run(run.inputs, {name: one for name, one in run.outputs.items() if name in names}) for run in runs]
        found = analyse(some, lags=lags, alpha=alpha / len(names), draws=draws * len(names), seed=seed, progress=told)
        before += len(names)
        edges += found.edges
        skipped += found.skipped
    return PermeabilityResult(tuple(edges), tuple(skipped), alpha=alpha, runs=len(runs))


def skip_reasons(result: PermeabilityResult) -> dict[str, str]:
    """Return why external fields could not be tested for an internal one, by external field."""
    reasons: dict[str, dict[str, None]] = {}
    for each in result.skipped:
        reasons.setdefault(each.external, {})[each.reason] = None
    return {name: "; ".join(some) for name, some in reasons.items()}


def _thinned(series: Series) -> Series:
    """Return each n-th sample of a series, so that there are not too many."""
    step = 1 + len(series.times) // _SAMPLES
    return Series(series.times[::step], series.values[::step])


def _times(outcome: Outcome, one: ExternalField) -> int:
    """Return how many messages of a field's topic came in a run."""
    return len(outcome.observed[one.topic].times) if one.topic in outcome.observed else 0


def as_numbers(outcomes: Sequence[Outcome], internals: Sequence[str]) -> list[dict[str, Series]]:
    """Return the internal fields of each run as numbers: a field with texts becomes one 0/1 series for each text.

    A field with a single text gives no series, and one with two texts gives one, as the other says the same.
    """
    texts = {
        name: Counter(one for each in outcomes for one in each.observed[name].values if isinstance(one, str))
        for name in internals
    }

    def told(series: Series, name: str) -> dict[str, Series]:
        if not texts[name]:
            return {name: series}
        often = [text for text, _ in texts[name].most_common(8)]
        often = often[: len(often) - 1] if len(texts[name]) <= 2 else often
        return {
            f"{name}{_IS}{text}": Series(series.times, tuple(float(value == text) for value in series.values))
            for text in often
        }

    return [
        {key: one for name in internals for key, one in told(outcome.observed[name], name).items()}
        for outcome in outcomes
    ]


def internal_of(told: str) -> str:
    """Return the internal field of a name from `as_numbers`."""
    return told.partition(_IS)[0]


def strongest(edges: Iterable[EdgeRecord]) -> dict[tuple[str, str], EdgeRecord]:
    """Return the strongest edge of each pair of fields, preferring permeable ones."""
    found: dict[tuple[str, str], EdgeRecord] = {}
    for edge in edges:
        known = found.get((edge.external, edge.internal))
        if known is None or (edge.permeable, edge.strength) > (known.permeable, known.strength):
            found[edge.external, edge.internal] = edge
    return found


def edge_record(edge: PermeabilityEdge, design: Design) -> EdgeRecord:
    """Return the record of an edge."""
    lag = edge.lag_s if design == "within runs" else 0.0
    told = {"internal": internal_of(edge.internal), "lag_s": lag, "design": design}
    return EdgeRecord.model_validate({**asdict(edge), **told})
