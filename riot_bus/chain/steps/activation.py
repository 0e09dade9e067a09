"""Step `activate`: external inputs that make the whole system fail, and the region around them (RIOT II-D)."""

from __future__ import annotations

import hashlib
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from riot_bus.backchain.activation import Activation, activate
from riot_bus.backchain.proposers import PORTFOLIO
from riot_bus.chain.base.external import driving_log
from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.whole.crash_region import FOLDER, axes_of, crash_region
from riot_bus.chain.whole.driven_system import AGAIN, DrivenSystem
from riot_bus.chain.whole.replay import Replay, replay
from riot_bus.findings.activation import ActivationRecord, RegionRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FieldsRecord, FindingRecord
from riot_bus.plugins import SEARCHES, hook
from riot_bus.vocabulary.errors import InconclusiveError, OutOfTimeError

_NO_TIME = "the region around it was not measured to its end: the time was over"
_NONE_ODD = "the unit failed with values that are not finite only, and no field that reaches it can have such"
_ONLY_ODD = "all failing trials of the unit had a value that is not finite, so only such values were tried"


def activation(
    step: StepRun, folder: Path, *, budget: int = 200, search: Sequence[str] = (), study: str = ""
) -> ActivationRecord:
    """Search the permeable external fields until the whole system fails; write `activation.mcap`.

    If runs of the whole system cannot show the failure, nothing is searched, and the record says why.

    Raises:
        ConfigError: An earlier step has not been done, or there is no such method or storage.
        InconclusiveError: No external field is permeable, so there is nothing to search.
    """
    shutil.rmtree(folder / FOLDER, ignore_errors=True)  # of an earlier search
    portfolio = [SEARCHES.load(name, where="--search") for name in search] or PORTFOLIO
    FieldsRecord.load(folder)
    permeable = PermeabilityRecord.load(folder)
    if not permeable.permeable:
        raise InconclusiveError(
            "no external field was found to reach the relevant ones, so the outside cannot be searched"
            if permeable.edges
            else "of no external field could be told whether it reaches the relevant ones",
            where=str(folder),
            hint="this finding stays at unit level; more runs (--runs) may show weaker effects",
        )
    driving = driving_log(step.workspace, step.workspace.context.file.system.trial_run)
    judged, why = step.workspace.judged_in_system(FindingRecord.load(folder), driving)
    if why:
        return _not_tested(why)
    system = DrivenSystem(step, folder, driving, judged, budget=max(budget, AGAIN[-1][0]))
    names = system.only_reached(permeable.permeable)
    beyond = [name for name in permeable.permeable if name not in names]
    within = f"the {step.workspace.context.file.system.trial_run.duration:g} s of a run"
    unset = f"{', '.join(beyond)}: no message came within {within} that could be changed in it" if beyond else ""
    if not names:
        return _not_tested(unset)
    odd, only_odd = system.odd_points(names)[:budget], system.only_odd()
    if only_odd and not odd:
        return _not_tested(_NONE_ODD)
    finite = 0 if only_odd else max(1, budget - len(odd))
    result = Activation(None, 0, None, ())
    shared = hook("study", "riot_bus_cluster")(study, _study_name(system, names)) if study else None
    if finite:
        result = activate(
            [system.fields[name].search_field() for name in names],
            system.search,
            seed=step.workspace.seed,
            budget=finite,
            parallelism=system.runner.parallelism,
            methods=portfolio,
            families=system.varied.families,
            promising=permeable.failing,
            progress=step.progress,
            shared=shared,
        )
    if result.found is None:
        result = result.followed_by(system.search_each(odd[: budget - result.runs]))
    left_out = f"; not tried: {unset}" if unset else ""
    if result.found is None:
        text = result.text + (f"; {_ONLY_ODD}" if only_odd else "") + left_out
        if limited := system.limited():
            text += f"; of constant values, the nearest are at the end of what may be tried for {', '.join(limited)}"
        end = _End(None, Replay(), None, text, system.controls() if system.chance else (0, 0))
    else:
        axes = [name for name in axes_of(permeable, system.fields) if name in names]
        end = _confirmed(system, result, result.found, axes, left_out)
    return _record(system, result, end)


class _End(NamedTuple):
    """Where a search has ended: at a point, or nowhere; `controls` are failed and all runs with nominal inputs."""

    found: Mapping[str, float] | None
    played: Replay
    region: RegionRecord | None
    text: str
    controls: tuple[int, int]


def _confirmed(
    system: DrivenSystem, result: Activation, point: Mapping[str, float], axes: Sequence[str], left_out: str
) -> _End:
    """Replay a failing point, as simple as possible, and measure the region around it."""
    found = system.needed(system.simplest(point))
    played, controls, region = _replayed(system, found), system.controls(), None
    try:
        region = crash_region(system, axes, found)
    except OutOfTimeError:
        left_out += f"; {_NO_TIME}"
    if region and not played.reliable and (deeper := system.deeper(found)) and system.run([deeper], "again")[0].failed:
        again = _replayed(system, deeper)
        if again.failed > played.failed:
            found, played = deeper, again
        else:
            _replayed(system, found)  # answered by the store; it writes the logs again
    return _End(found, played, region, result.with_inputs(system.in_words(found)) + left_out, controls)


def _record(system: DrivenSystem, result: Activation, end: _End) -> ActivationRecord:
    found, played = end.found, end.played
    return ActivationRecord(
        found=None if found is None else system.told(found),
        runs=result.runs,
        best_distance=result.best_distance,
        replays=played.total,
        replays_failed=played.failed,
        region=end.region,
        points=tuple(system.points),
        messages=played.messages,
        needed=played.needed,
        needed_proven=played.proven,
        text=end.text,
        unneeded=tuple(sorted(system.moved(result.found or {}) - system.moved(found or {}))),
        controls=end.controls[1],
        controls_failed=end.controls[0],
        chance=system.chance,
        others=dict(system.others.most_common()),
        controls_others=dict(system.controls_others.most_common()),
        replays_others=dict(Counter(played.others).most_common()),
        played=bool(system.driving),
    )


def _replayed(system: DrivenSystem, point: Mapping[str, float]) -> Replay:
    return replay(system, *system.failing.get(frozenset(point.items()), (None, None)))


def _not_tested(why: str) -> ActivationRecord:
    return ActivationRecord(found=None, runs=0, best_distance=None, text=f"not tested: {why}")


def _study_name(system: DrivenSystem, names: Sequence[str]) -> str:
    """Return a name that is shared by searches in which points and distances have the same meaning."""
    fields = [(repr(field.search_field()), field.choices) for field in map(system.fields.__getitem__, names)]
    same = repr((system.step.workspace.fingerprint, system.record.rule, sorted(system.record.scale.items()), fields))
    return f"{system.finding.system} {system.finding.id} {hashlib.sha256(same.encode()).hexdigest()[:12]}"
