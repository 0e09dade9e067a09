"""Permeability: whether, and how strongly, an external field affects an internal one (RIOT II-C).

All external fields are driven at once, inside a few long runs, each by its own random piecewise-constant signal. The
fields that explain an internal series are selected forward over lagged linear and even terms. The null distribution
comes from redrawing the signals (conditional randomisation): each test is exact whatever the system does, and the
maximum over the fields not yet selected is compared. Each further round needs a discovery and gives the rest one more
chance of `alpha`, so `alpha` bounds the share of false discoveries per internal field, not the chance of any.

A system that takes one value per run is analysed with the same code: give one `Run` whose series hold one sample per
system run (time = number of the run), signals with `hold=1`, and `lags=1`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from riot_bus.backchain.fir import Floats, LagColumns, RunColumns, lag_grid, standardise
from riot_bus.backchain.responses import CHANNELS, Effect, residuals
from riot_bus.backchain.strength import estimate, student_reach
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.trial import Progress, Series

_MIN_SAMPLES = 8
_FEWEST, _SUSPICION = 4, 0.002
"""Fewest runs to judge a field's first value, and the chance that one without any effect is suspected; a suspicion
needs further runs, which cost more than all others together."""
_LARGEST = 1e3  # driven values are within 1; fourth powers of 1e3 are precise to 2e-4


@dataclass(frozen=True, slots=True)
class FieldDrive:
    """One external field in one run.

    Attributes:
        series: Delivery times of its topic's messages (seconds) and the values that they carried, in order.
        signal: The signal that set the values; its seed is not used.
        first: The topic's index of the first message in `series`.
    """

    series: Series
    signal: Signal
    first: int = 0


@dataclass(frozen=True, slots=True)
class Run:
    """One long system run: its driven external and its recorded internal fields (both by `topic:field`)."""

    inputs: Mapping[str, FieldDrive]
    outputs: Mapping[str, Series]


@dataclass(frozen=True, slots=True)
class PermeabilityEdge:
    """Test result for the path from one external to one internal field.

    Attributes:
        strength: Share of the variance within a run that the external field explains, 0 to 1.
        low: Lower end of the jackknife interval (95 %) of the strength, over runs; 0 if the effect is not significant.
        lag_s: Lag at which the external field shows most, in seconds.
        p_value: Chance of such evidence, or stronger, from any of the fields left at that step, without an effect.
        effect: Aspect of the internal field whose variance the strength is a share of.
        detectable: Smallest share of the variance at which an effect of a single lag would have shown at this step;
            None if the effect is significant, or if no effect would have shown.
    """

    external: str
    internal: str
    strength: float
    low: float
    high: float
    lag_s: float
    p_value: float
    permeable: bool
    effect: Effect = "level"
    detectable: float | None = None


@dataclass(frozen=True, slots=True)
class Skipped:
    """A pair that could not be tested, and why."""

    external: str
    internal: str
    reason: str


@dataclass(frozen=True, slots=True)
class PermeabilityResult:
    """All tested pairs, strongest first per internal field, and those that could not be tested."""

    edges: tuple[PermeabilityEdge, ...]
    skipped: tuple[Skipped, ...] = ()
    alpha: float = 0.05
    runs: int = 0

    def permeable(self) -> tuple[PermeabilityEdge, ...]:
        """Return the significant edges."""
        return tuple(edge for edge in self.edges if edge.permeable)

    def doubtful(self) -> tuple[PermeabilityEdge, ...]:
        """Return the significant edges whose interval of the strength contains 0: some of them are chance findings."""
        return tuple(edge for edge in self.permeable() if edge.low <= 0)

    def confirmed_by(self, fresh: PermeabilityResult, together: PermeabilityResult) -> PermeabilityResult:
        """Return the result of all runs, in which an edge whose interval contains 0 needs confirmation by other runs.

        An edge that the `fresh` ones do not confirm is not permeable and gets their p-value.
        """
        clear = {_pair(edge) for edge in self.permeable() if edge.low > 0}
        asked = {_pair(edge): edge for edge in fresh.edges}
        known = {_pair(edge) for edge in self.permeable()}

        def judged(edge: PermeabilityEdge) -> PermeabilityEdge:
            pair, again = _pair(edge), asked.get(_pair(edge))
            shown = (pair in clear and edge.low > 0) or (again is not None and again.permeable)
            if not edge.permeable or (pair in known and shown):
                return edge
            return replace(edge, permeable=False, low=0.0, p_value=1.0 if again is None else again.p_value)

        return replace(together, edges=tuple(map(judged, together.edges)))


def _pair(edge: PermeabilityEdge) -> tuple[str, str]:
    return edge.external, edge.internal


@dataclass(slots=True)
class _Output:
    name: str
    runs: list[int] = field(default_factory=list)
    times: list[Floats] = field(default_factory=list)
    values: list[Floats] = field(default_factory=list)


def analyse(
    runs: Sequence[Run],
    *,
    lags: int = 12,
    draws: int = 199,
    alpha: float = 0.05,
    seed: int = 0,
    progress: Progress | None = None,
) -> PermeabilityResult:
    """Find the external fields that reach the internal ones (RIOT II-C).

    Runs in which an output is missing, constant or shorter than 8 samples do not count for it; runs may differ in
    level, scale and number of samples.

    Args:
        runs: The multiplexed runs; the more, the more power (8 are usually enough).
        lags: Number of lags, in samples of the internal field (and in messages of the external one, if rates differ).
        draws: Number of redraws of the signals for the null distribution; the smallest p-value is 1 / (draws + 1).
        alpha: Accepted share of false discoveries, per internal field.
        seed: Seed of the redraws.
        progress: Called after each internal field.

    Raises:
        ValueError: `lags` or `draws` is not positive.
    """
    if lags < 1 or draws < 1:
        raise ValueError(f"lags and draws must be positive, not {lags} and {draws}")
    externals = sorted({name for run in runs for name in run.inputs})
    internals = sorted({name for run in runs for name in run.outputs})
    edges: list[PermeabilityEdge] = []
    skipped: list[Skipped] = []
    for done, internal in enumerate(internals):
        output = _usable(runs, internal)
        if not output.runs:
            reason = "the internal field was missing, constant or too short in every run"
            skipped += [Skipped(external, internal, reason) for external in externals]
        else:
            columns = {name: _columns(runs, name, output, lags=lags) for name in externals}
            driven = {name: found for name, found in columns.items() if found is not None}
            reason = "the external field was not driven, or kept one value, in every usable run"
            skipped += [Skipped(name, internal, reason) for name in externals if name not in driven]
            edges += _select(output, driven, draws=draws, alpha=alpha, seed=seed)
        if progress is not None:
            progress(done + 1, len(internals), f"permeability of {internal}")
    return PermeabilityResult(tuple(edges), tuple(skipped), alpha=alpha, runs=len(runs))


def may_latch(runs: Sequence[Run], external: str, internal: str) -> bool:
    """Return whether the first value of a field in each run seems to decide the mean of an internal field.

    This costs no further runs, but proves nothing: so few runs only show which fields are worth testing.
    """
    series = [
        (run.inputs[external].series.values, np.asarray(run.outputs[internal].values, dtype=np.float64))
        for run in runs
        if external in run.inputs and run.inputs[external].series.values and run.outputs[internal].values
    ]
    pairs = [(values[0], float(followed.mean())) for values, followed in series]
    if len(pairs) < _FEWEST or not np.isfinite(pairs).all() or not np.ptp(pairs, axis=0).all():
        return False
    freedom, correlation = len(pairs) - 2, abs(float(np.corrcoef(np.array(pairs).T)[0, 1]))
    reach = student_reach(freedom, confidence=1 - _SUSPICION)
    return bool(correlation * np.sqrt(freedom) >= reach * np.sqrt(max(0.0, 1 - correlation**2)))


def _usable(runs: Sequence[Run], internal: str) -> _Output:
    output = _Output(internal)
    for number, run in enumerate(runs):
        series = run.outputs.get(internal)
        if series is None:
            continue
        count = min(len(series.times), len(series.values))
        values = standardise(np.asarray(series.values[:count], dtype=np.float64))
        if count >= _MIN_SAMPLES and values.any():
            output.runs.append(number)
            output.times.append(np.asarray(series.times[:count], dtype=np.float64))
            output.values.append(values)
    return output


def _step(times: Sequence[Floats]) -> float:
    gaps = np.concatenate([np.diff(one) for one in times])
    return float(np.median(gaps)) if len(gaps) else 0.0


def _columns(runs: Sequence[Run], external: str, output: _Output, *, lags: int) -> LagColumns | None:
    drives: list[tuple[int, FieldDrive, Floats, Floats]] = []
    start = 0
    starts: list[slice] = []
    for place, number in enumerate(output.runs):
        rows = slice(start, start + len(output.times[place]))
        start = rows.stop
        starts.append(rows)
        drive = runs[number].inputs.get(external)
        if drive is None:
            continue
        count = min(len(drive.series.times), len(drive.series.values))
        values = np.asarray(drive.series.values[:count], dtype=np.float64)
        if count == 0 or not np.isfinite(values).all() or not np.ptp(values) > 0:
            continue
        drives.append((place, drive, np.asarray(drive.series.times[:count], dtype=np.float64), values))
    if not drives:
        return None
    input_step = _step([times for _, _, times, _ in drives])
    grid = lag_grid(_step(output.times), input_step, lags=lags)
    parts = []
    for place, drive, times, values in drives:
        unit = drive.signal.amplitude or float(np.ptp(values))
        scaled = np.clip((values - drive.signal.center) / unit, -_LARGEST, _LARGEST)
        index = grid.indices(times, output.times[place])
        parts.append(RunColumns(starts[place], index, scaled, drive.signal, drive.first))
    return LagColumns(grid, input_step, tuple(parts), start)


class _Evidence(NamedTuple):
    """Standardised evidence that something follows a field.

    Attributes:
        scores: Scores by channel, first the observed ones, then those of each redraw (1 + draws x channels).
        usual: Mean of the cube root of the level's statistic at its best lag.
        deviation: Standard deviation of that cube root.
    """

    scores: Floats
    usual: float
    deviation: float

    def share(self, limit: float) -> float:
        """Return the share of the level's residual that one lag must explain for a score above a limit."""
        return float(np.clip(self.usual + limit * self.deviation, 0.0, 1.0)) ** 3


def _evidence(columns: LagColumns, left_over: Floats, *, draws: int, seed: Sequence[int]) -> _Evidence:
    redrawn = columns.correlate_draws(left_over, draws=draws, seed=seed)
    squared = np.concatenate([columns.correlate(left_over), redrawn])
    lags = columns.lags
    statistics = [
        statistic
        for part in (squared[:, :lags], squared[:, lags:])
        for statistic in (part.max(axis=1), part.mean(axis=1))
    ]
    # Cube roots of sums of squares are nearly normal, so channels and fields of different shape compare fairly.
    roots = np.cbrt(np.stack(statistics, axis=1))
    deviation = roots.std(axis=0)
    scores = np.where(deviation > 1e-12, (roots - roots.mean(axis=0)) / np.maximum(deviation, 1e-12), 0.0)
    return _Evidence(scores.max(axis=1), float(roots[:, 0, 0].mean()), float(deviation[0, 0]))


def _effect(scores: Floats) -> Effect:
    """Return which aspect follows the field: the level if the effect shows there about as well as anywhere."""
    level = max(score for score, channel in zip(scores, CHANNELS, strict=True) if channel == "level")
    return "level" if level >= 0.5 * scores.max() else CHANNELS[int(scores.argmax())]


def _select(
    output: _Output, columns: Mapping[str, LagColumns], *, draws: int, alpha: float, seed: int
) -> list[PermeabilityEdge]:
    names = sorted(columns)
    designs = {name: columns[name].design() for name in names}
    raw, left_over = residuals(output.values, designs, selected=())
    p_values: dict[str, float] = {}
    effects: dict[str, Effect] = {}
    selected: list[str] = []
    detectable: dict[str, float] = {}
    spare = min(draws, int(alpha * (draws + 1))) - 1  # redraws that may score as high as a discovery
    for _ in range(8):
        left = [name for name in names if name not in selected]
        if not left:
            break
        scores: dict[str, Floats] = {}
        evidence: dict[str, _Evidence] = {}
        for name in left:
            found = _evidence(columns[name], left_over, draws=draws, seed=(seed, names.index(name)))
            scores[name] = found.scores.max(axis=1)
            effects[name] = _effect(found.scores[0])
            evidence[name] = found
        null = np.max([one[1:] for one in scores.values()], axis=0)
        if spare >= 0:
            left_share = float((left_over[:, 0] ** 2).sum() / max(1e-12, (raw[:, 0] ** 2).sum()))
            limit = float(np.sort(null)[::-1][spare])
            detectable = {name: min(1.0, left_share * one.share(limit)) for name, one in evidence.items()}
        p_values |= {name: (1 + int((null >= one[0]).sum())) / (draws + 1) for name, one in scores.items()}
        new = [name for name in left if p_values[name] <= alpha]
        if not new:
            break
        selected += new
        raw, left_over = residuals(output.values, designs, selected=selected)
    by_effect: dict[Effect, list[str]] = defaultdict(list)
    for name in names:
        by_effect[effects[name]].append(name)
    groups = np.repeat(np.arange(len(output.values)), [len(one) for one in output.values])
    edges: list[PermeabilityEdge] = []
    for effect, members in by_effect.items():
        response = raw[:, CHANNELS.index(effect)]
        shares = estimate(response, designs, selected=selected, asked=members, groups=groups)
        edges += [
            PermeabilityEdge(
                share.name,
                output.name,
                share.strength,
                share.low if share.name in selected else 0.0,
                share.high,
                columns[share.name].lag(share.column),
                p_values[share.name],
                share.name in selected,
                effect,
                None if share.name in selected else detectable.get(share.name),
            )
            for share in shares
        ]
    return sorted(edges, key=lambda edge: (not edge.permeable, -edge.strength, edge.p_value, edge.external))
