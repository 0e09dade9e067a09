"""Step `permeability`: which external fields reach the relevant ones (RIOT II-C)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from riot_bus.backchain.permeability import may_latch
from riot_bus.chain.base.external import ExternalField, driving_log, external_fields, left_out, message_rate
from riot_bus.chain.base.logs import internal_name, nominal_values
from riot_bus.chain.base.workspace import StepRun, Workspace
from riot_bus.chain.unit.questions import named_fields
from riot_bus.chain.whole.driven import DrivenRuns, Perturbed, Usual, edge_record, internal_of, skip_reasons, strongest
from riot_bus.chain.whole.intermediate import intermediate_fields, most_permeable_paths, with_strengths
from riot_bus.chain.whole.topic_graphs import declared_graph, topics_named
from riot_bus.findings.permeability import Design, EdgeRecord, PermeabilityRecord
from riot_bus.findings.records import FindingRecord
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.order import order_of

_ALPHA, _ALPHA_AGAIN = 0.01, 0.05
"""Accepted shares of false discoveries, the second of further runs, which only have to confirm effects."""
_SEARCHED = 3
"""Most runs that search for fields that freeze the inner ones, as a multiple of the long runs."""
_BETWEEN = 3
"""Runs in which fields are constant, as a multiple of the long runs: each yields one value."""
_UNTOLD = "no internal field had values by which it could be told"
_UNSEEN, _IDLE = "it had no value in any long run", "it was constant, or had too few values, in every run"
_FREEZING = "inner fields hardly move when it is driven, as if it was refused, so others were driven without it"
_UNSETTLED = (
    "inner fields hardly move when it is driven with others, and the runs did not suffice to tell which of them it is"
)
_ALONE = "a text that is always the same in the nominal log, and riot.toml states no other under [external.values]"


def permeability(step: StepRun, folder: Path, *, runs: int = 8, prune: bool = True) -> PermeabilityRecord:
    """Perturb the external fields of the whole system, and measure their effect on the fields that matter.

    These internal fields are the relevant ones and those of the rule.

    Args:
        runs: Number of long runs of the whole system. Half as many more follow if an effect is so weak that it may be
            chance. Three times as many, with constant fields, follow if some fields show nothing within runs (such as
            those of a message that is sent once), if nothing reaches an internal field, or if only the first value of a
            field seems to count. If still nothing reaches one, as many again follow with values beyond the nominal
            ones. If an effect nearly shows in either of these, their number is doubled.

    Raises:
        ConfigError: The step before has not been done, or nothing external is described.
        InconclusiveError: Nothing external can reach the relevant fields.
    """
    finding, workspace, file = FindingRecord.load(folder), step.workspace, step.workspace.context.file
    names = named_fields(folder)
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
    reach = [field for field in fields if not prune or field.parameter or field.topic in reaching]
    pruned = tuple(field.name for field in fields if field not in reach)
    driven = [field for field in reach if not field.alone]
    if not internals or not driven:
        raise InconclusiveError(
            "no external topic leads to the relevant fields by the inputs and outputs that riot.toml declares",
            where=str(file.path),
            hint="are `inputs` and `outputs` of all components complete? --no-prune tests everything",
        )
    sources = sorted({field.topic for field in driven if not field.parameter})
    outside = frozenset().union(*(topics_named(one, keys, registry) for one in file.external.topics))
    intermediates = intermediate_fields(workspace, graph, topics, outside)
    observed = (*internals, *intermediates, *sources)
    pace = file.system.perturbed_run
    driving = driving_log(workspace, pace)
    runner = step.system_runner(observe=observed, pace=pace)
    usual = _usual(workspace, internals)
    system = DrivenRuns(step, runner, driving, internals, usual, pace.speed, finding.signature, intermediates)
    measured = _measured(system, driven, runs)
    edges, told = measured.edges, {external for external, _ in measured.edges}
    failed = system.failures.pop(finding.signature, 0)
    trees = [graph.backtrack_tree(topic, outside).as_json() for topic in topics]
    known = (*edges.values(), *measured.intermediate.values())
    return PermeabilityRecord(
        edges=tuple(sorted(edges.values(), key=_rank)),
        intermediate=tuple(sorted(measured.intermediate.values(), key=_rank)),
        paths=most_permeable_paths(trees, known),
        runs=measured.runs,
        untested={
            name: why
            for name, why in left_out(workspace, fields).items()
            if not prune or not {name, name.rpartition(":")[0]} & keys.keys() - reaching
        }
        | {
            field.name: _ALONE if field.alone else measured.untold.get(field.name, _UNTOLD)
            for field in reach
            if field.name not in told
        },
        pruned=pruned,
        nominal={field.name: (field.nominal, field.spread) for field in driven if field.name not in measured.apart},
        tree=[with_strengths(tree, known) for tree in trees],
        system=finding.system,
        unseen={
            name: _IDLE if name in measured.valued else _UNSEEN
            for name in internals
            if name not in {internal for _, internal in edges}
        },
        failed=failed,
        failing=tuple(system.failing),
        others=dict(system.failures.most_common()),
        played=bool(driving),
    )


class _Measured(NamedTuple):
    """What runs have shown.

    Attributes:
        edges: Results for pairs of external and internal fields.
        intermediate: The same for external and intermediate ones.
        untold: External fields that could not be judged, and why; of these, `apart` were left out of the runs.
        valued: Internal fields with a value in any run.
    """

    edges: dict[tuple[str, str], EdgeRecord]
    intermediate: dict[tuple[str, str], EdgeRecord]
    untold: dict[str, str]
    apart: Collection[str]
    valued: set[str]
    runs: int


def _measured(system: DrivenRuns, fields: Sequence[ExternalField], runs: int) -> _Measured:
    """Drive fields within runs, and those that show nothing there, or whose first value may count, between runs."""
    signalled = [field for field in fields if not field.constant]
    done, apart, count = _driven_without_refused(system, signalled, runs)
    outcomes = [outcome for _, outcome in done]
    for field in signalled:
        if field.name not in apart and (why := system.why_undriven(field, outcomes)):
            apart[field.name] = why
    driven, signalled = ([field for field in some if field.name not in apart] for some in (fields, signalled))
    result = system.analysed(done, alpha=_ALPHA)
    if result.doubtful():
        fresh = system.within(signalled, range(count, count + max(4, runs // 2)))
        done, count = done + fresh, count + len(fresh)
        again = system.analysed(fresh, alpha=_ALPHA_AGAIN)
        result = result.confirmed_by(again, system.analysed(done, alpha=_ALPHA))
    edges = strongest(edge_record(edge, "within runs") for edge in result.edges)
    beside = system.analysed(done, alpha=_ALPHA, intermediate=True)
    intermediate = strongest(_unless_doubtful(edge_record(edge, "within runs")) for edge in beside.edges)
    within = system.runs(done)
    seen = {name for run in within for name, series in run.outputs.items() if series.values}
    valued = {name for name in system.internals if any(outcome.observed[name].values for _, outcome in done)}
    untold, tested = skip_reasons(result), {pair: [edge.design] for pair, edge in edges.items()}
    told, reached = {external for external, _ in edges}, {pair for pair, edge in edges.items() if edge.permeable}
    constant = [
        field
        for field in driven
        if not _all_reached(edges, map(internal_of, seen))
        or (seen and field.name not in told)
        or any(may_latch(within, field.name, name) for name in seen if (field.name, internal_of(name)) not in reached)
    ]
    designs: tuple[tuple[Design, Sequence[ExternalField]], ...] = (
        ("between runs", constant),
        ("beyond nominal", driven),
    )
    for design, some in designs:
        if some and (design == "between runs" or not _all_reached(edges, valued)):
            answers = system.between(some, range(count, count + _BETWEEN * runs), alpha=_ALPHA, design=design)
            count += answers.runs
            untold |= answers.untold
            intermediate = strongest((*intermediate.values(), *map(_unless_doubtful, answers.intermediate)))
            for edge in answers.edges:
                pair = edge.external, edge.internal
                tested.setdefault(pair, []).append(design)
                if pair not in edges or (edge.permeable and not edges[pair].permeable):
                    edges[pair] = edge
    edges = {pair: edge.model_copy(update={"tested": tuple(tested[pair])}) for pair, edge in edges.items()}
    return _Measured(edges, intermediate, untold | apart, apart.keys(), valued, count)


def _driven_without_refused(
    system: DrivenRuns, fields: Sequence[ExternalField], runs: int
) -> tuple[list[Perturbed], dict[str, str], int]:
    """Return the runs in which fields are driven, the fields left out and why, and the number of all runs."""
    done = system.within(fields, range(runs))
    if sum(system.freezes(outcome) for _, outcome in done) <= runs // 2:
        return done, {}, runs
    freezing, unsettled, spent = system.freezing(fields, range(runs, (1 + _SEARCHED) * runs))
    apart = {field.name: _FREEZING for field in freezing} | {field.name: _UNSETTLED for field in unsettled}
    if not apart:
        return done, {}, runs + spent
    first = runs + spent
    left = [field for field in fields if field.name not in apart]
    return system.within(left, range(first, first + runs)), apart, first + runs


def _usual(workspace: Workspace, internals: Sequence[str]) -> dict[str, Usual]:
    """Return how internal fields behave in the nominal log, and how many values to expect in a perturbed run."""
    registry, system = workspace.context.registry, workspace.context.file.system
    messages = workspace.nominal_messages()
    paths: dict[str, list[str]] = {}
    for name in internals:
        topic, _, path = name.rpartition(":")
        paths.setdefault(topic, []).append(path)
    values = nominal_values(messages, paths, registry=registry)
    times: dict[str, list[int]] = {topic: [] for topic in paths}
    for message in messages:
        if (topic := registry.topic(message.key)) in times:
            times[topic].append(message.time)
    found = {}
    for name in internals:
        rate, seen = message_rate(times[name.rpartition(":")[0]]), values[name]
        count = rate / system.nominal_run.speed * system.perturbed_run.duration
        found[name] = Usual(rate, min(count, len(seen)), len(set(seen)) > 1)
    return found


def _all_reached(edges: Mapping[tuple[str, str], EdgeRecord], internals: Iterable[str]) -> bool:
    """Return whether some external field reaches each of these."""
    return {internal for (_, internal), edge in edges.items() if edge.permeable} >= set(internals)


def _unless_doubtful(edge: EdgeRecord) -> EdgeRecord:
    """Return an edge, not permeable if its interval contains 0: no further runs settle intermediate fields."""
    return edge.model_copy(update={"permeable": edge.permeable and edge.low > 0})


def _rank(edge: EdgeRecord) -> tuple[object, ...]:
    return edge.internal, not edge.permeable, -edge.strength, edge.p_value, edge.external
