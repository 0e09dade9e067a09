"""Step `permeability`: which external fields reach the relevant ones (RIOT II-C)."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from riot_bus.backchain.permeability import FieldDrive, PermeabilityEdge, PermeabilityResult, Run, analyse, may_latch
from riot_bus.chain.external import ExternalField, driving_log, external_fields, message_rate
from riot_bus.chain.logs import internal_name
from riot_bus.chain.topic_graphs import declared_graph
from riot_bus.findings.records import EdgeRecord, FieldsRecord, FindingRecord, PermeabilityRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.injection import Injection, Signal
from riot_bus.vocabulary.order import order_of
from riot_bus.vocabulary.trial import Series, TestCase

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from riot_bus.chain.workspace import StepRun, Workspace
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Outcome, Runner

__all__ = ["permeability"]

_HOLD = 5
_ALPHA = 0.01
_ALPHA_AGAIN = 0.05
"""In further runs, of which only what has been found already is asked."""
_FEWEST_AGAIN = 4
_DRAWS = 399
_BETWEEN = 3
"""Runs in which fields are constant, as a multiple of the long ones: each tells one value."""
_SUMMARIES: dict[str, Callable[[Sequence[float]], Any]] = {"mean": np.mean, "spread": np.std, "last": itemgetter(-1)}
"""What of an internal field is told of a run as a whole."""
_UNTOLD = "no internal field had values by which it could be told"


def permeability(step: StepRun, folder: Path, *, runs: int = 8, prune: bool = True) -> PermeabilityRecord:
    """Perturb the external fields of the whole system, and see what comes of the relevant ones and those of the rule.

    Args:
        step: The running step.
        folder: The finding.
        runs: Long runs of the whole system; half as many more follow if an effect is so weak that it may be chance, and
            three times as many in which fields are constant, if some tell nothing within runs, such as those of a
            message that is sent once, if nothing reaches an internal field, or if only the first value of a field
            seems to count.
        prune: Leave out external topics that cannot reach a relevant topic by the declared graph.

    Raises:
        ConfigError: The step before has not been done, or nothing external is described.
        InconclusiveError: Nothing external can reach the relevant fields.
    """
    finding, relevant = FindingRecord.load(folder), FieldsRecord.load(folder)
    workspace = step.workspace
    file = workspace.context.file
    learnt = Rule.from_json(RuleRecord.load(folder).rule).variables if RuleRecord.exists(folder) else ()
    names = [*(record.name for record in relevant.fields), *learnt]
    if orders := [name for name in names if order_of(name)]:
        raise InconclusiveError(
            f"the failure depends on an order of messages ({orders[0]}), which runs of the whole system do not drive",
            where=str(folder),
            hint="this finding stays at unit level; riot guard keeps such an order from the unit",
        )
    internals = sorted(set(map(internal_name, names)))
    registry = workspace.context.registry
    keys = {registry.topic(message.key): message.key for message in workspace.nominal_messages()}
    graph = declared_graph(file, keys, registry)
    topics = sorted({name.rpartition(":")[0] for name in internals})
    reaching = frozenset().union(*(graph.reaching(topic) for topic in topics))
    fields = external_fields(workspace)
    driven = [field for field in fields if not prune or field.topic in reaching]
    pruned = tuple(field.name for field in fields if field not in driven)
    if not internals or not driven:
        raise InconclusiveError(
            "no external topic leads to the relevant fields by the inputs and outputs that riot.toml declares",
            where=str(file.path),
            hint="are `inputs` and `outputs` of all components complete? --no-prune tests everything",
        )
    rate = _slowest_internal(workspace, topics)
    driving = driving_log(workspace, file.system.perturbed_run)
    runner = step.system_runner(
        observe=(*internals, *sorted({field.topic for field in driven})), pace=file.system.perturbed_run
    )

    def perturbed(numbers: range) -> list[Run]:
        """Return runs in which all external fields are driven, each by its own signal in each run."""
        found: list[Run] = []
        for start in range(numbers.start, numbers.stop, runner.parallelism):
            plans = [
                {field: _signal(field, rate, seed=workspace.seed, run=run) for field in driven}
                for run in range(start, min(start + runner.parallelism, numbers.stop))
            ]
            cases = [
                TestCase(
                    driving,
                    tuple(Injection(field.topic, field.path, signal) for field, signal in plan.items()),
                    seed=workspace.seed + start + number,
                )
                for number, plan in enumerate(plans)
            ]
            found += [_run(plan, outcome, internals) for plan, outcome in zip(plans, runner.run(cases), strict=True)]
            doing = f"{counted(len(driven), 'external field')} perturbed at once"
            step.progress(numbers.start + len(found), numbers.stop, doing)
        return found

    def analysed(some: Sequence[Run], alpha: float) -> PermeabilityResult:
        return analyse(some, alpha=alpha, draws=_DRAWS, seed=workspace.seed)

    done = perturbed(range(runs))
    result = analysed(done, _ALPHA)
    if result.doubtful():
        fresh = perturbed(range(runs, runs + max(_FEWEST_AGAIN, runs // 2)))
        done += fresh
        result = result.confirmed_by(analysed(fresh, _ALPHA_AGAIN), analysed(done, _ALPHA))
    edges = {(edge.external, edge.internal): _edge(edge, "within runs") for edge in result.edges}
    told, reached = {external for external, _ in edges}, {edge.internal for edge in result.permeable()}
    numeric = {name for run in done for name, series in run.outputs.items() if series.values}
    constant = [
        field
        for field in driven
        if numeric - reached
        or (numeric and field.name not in told)
        or any(may_latch(done, field.name, name) for name in numeric if not _is_permeable(edges, field.name, name))
    ]
    count = _BETWEEN * runs if constant else 0
    for edge in _constant_in_runs(step, runner, driving, constant, sorted(numeric), first=len(done), count=count):
        pair = edge.external, edge.internal
        if pair not in edges or edge.permeable:
            edges[pair] = edge
    told = {external for external, _ in edges}
    return PermeabilityRecord(
        edges=tuple(sorted(edges.values(), key=_rank)),
        runs=len(done) + count,
        untested={field.name: _UNTOLD for field in driven if field.name not in told},
        pruned=pruned,
        nominal={field.name: (field.nominal, field.spread) for field in driven},
        tree=[graph.backtrack_tree(topic, file.external.topics).as_json() for topic in topics],
        system=finding.system,
        played=bool(driving),
    )


def _slowest_internal(workspace: Workspace, topics: Sequence[str]) -> float:
    """Return the lowest message rate of the relevant topics in the nominal log."""
    registry = workspace.context.registry
    times: dict[str, list[int]] = {topic: [] for topic in topics}
    for message in workspace.nominal_messages():
        topic = registry.topic(message.key)
        if topic in times:
            times[topic].append(message.time)
    return min(message_rate(some) for some in times.values())


def _signal(field: ExternalField, rate: float, *, seed: int, run: int, hold: int | None = None) -> Signal:
    """Return a signal over the field's nominal range, held for about five samples of the internal series."""
    half = (field.high - field.low) / 2
    if hold is None:
        hold = max(1, round(_HOLD * field.rate / rate)) if rate else _HOLD
    own = zlib.crc32(f"{seed}:{run}:{field.name}".encode())
    return Signal((field.high + field.low) / 2, half, hold=hold, seed=own, integer=field.integer)


def _run(plan: Mapping[ExternalField, Signal], outcome: Outcome, internals: Sequence[str]) -> Run:
    inputs = {}
    for field, signal in plan.items():
        times = outcome.observed[field.topic].times
        inputs[field.name] = FieldDrive(
            Series(times, tuple(signal.value(index) for index in range(len(times)))), signal
        )
    return Run(inputs, {name: outcome.observed[name] for name in internals})


def _is_permeable(edges: Mapping[tuple[str, str], EdgeRecord], external: str, internal: str) -> bool:
    return (external, internal) in edges and edges[external, internal].permeable


def _constant_in_runs(
    step: StepRun,
    runner: Runner,
    driving: tuple[Message, ...],
    fields: Sequence[ExternalField],
    internals: Sequence[str],
    *,
    first: int,
    count: int,
) -> list[EdgeRecord]:
    """Return what fields do to internal ones in further runs, in each of which they have one value.

    Args:
        step: The running step.
        runner: Executes runs of the whole system.
        driving: What is played to it; nothing where external components drive it.
        fields: The external fields.
        internals: The internal fields.
        first: Runs that there were before.
        count: Further runs.
    """
    seed = step.workspace.seed
    signals = {field: _signal(field, 0.0, seed=seed, run=-1, hold=1) for field in fields}
    cases = [
        TestCase(
            driving,
            tuple(_constant(field, signal.value(number)) for field, signal in signals.items()),
            seed + first + number,
        )
        for number in range(count)
    ]
    outcomes: list[Outcome] = []
    for start in range(0, count, runner.parallelism):
        outcomes += runner.run(cases[start : start + runner.parallelism])
        step.progress(len(outcomes), count, f"{counted(len(fields), 'external field')} constant in each run")
    return _between(signals, outcomes, internals, seed=seed) if outcomes else []


def _constant(field: ExternalField, value: float) -> Injection:
    return Injection(field.topic, field.path, round(value) if field.integer else value)


def _between(
    signals: Mapping[ExternalField, Signal], outcomes: Sequence[Outcome], internals: Sequence[str], *, seed: int
) -> list[EdgeRecord]:
    """Return what fields do that had one value in each run: to the mean, the spread and the last of internal fields.

    Args:
        signals: Of each field; the value in run i is that of message i.
        outcomes: Of the runs.
        internals: The internal fields.
        seed: Seed of the redraws.
    """
    count = range(len(outcomes))
    inputs = {
        field.name: FieldDrive(Series(tuple(map(float, count)), tuple(map(signal.value, count))), signal)
        for field, signal in signals.items()
    }
    found: dict[tuple[str, str], EdgeRecord] = {}
    for summary in _SUMMARIES.values():
        outputs = {}
        for name in internals:
            seen = [(float(run), outcomes[run].observed[name].values) for run in count]
            kept = [(run, float(summary(values))) for run, values in seen if values]
            outputs[name] = Series(tuple(run for run, _ in kept), tuple(value for _, value in kept))
        # each summary is one more chance to be found by chance
        alpha = _ALPHA / len(_SUMMARIES)
        for edge in analyse([Run(inputs, outputs)], lags=1, alpha=alpha, draws=_DRAWS, seed=seed).edges:
            known = found.get((edge.external, edge.internal))
            if known is None or (edge.permeable, edge.strength) > (known.permeable, known.strength):
                found[edge.external, edge.internal] = _edge(edge, "between runs")
    return list(found.values())


def _edge(edge: PermeabilityEdge, design: Literal["within runs", "between runs"]) -> EdgeRecord:
    return EdgeRecord(
        external=edge.external,
        internal=edge.internal,
        permeable=edge.permeable,
        strength=edge.strength,
        low=edge.low,
        high=edge.high,
        lag_s=edge.lag_s if design == "within runs" else 0.0,
        p_value=edge.p_value,
        design=design,
    )


def _rank(edge: EdgeRecord) -> tuple[object, ...]:
    return edge.internal, not edge.permeable, -edge.strength, edge.p_value, edge.external
