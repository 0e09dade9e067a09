from __future__ import annotations

import numpy as np
import pytest

from riot_bus.backchain.fir import LagColumns, RunColumns, lag_grid, standardise
from riot_bus.backchain.permeability import FieldDrive, PermeabilityEdge, PermeabilityResult, Run, analyse, may_latch
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.trial import Series

SAMPLES = 60


def make_runs(count, response, *, fields=8, seed=0, rate=1, samples=SAMPLES):
    """Runs with `fields` driven inputs; `rate` input messages per output sample."""
    rng = np.random.default_rng(seed)
    out_times = tuple(0.1 * at for at in range(samples))
    in_times = tuple(0.1 / rate * at for at in range(samples * rate))
    runs = []
    for number in range(count):
        drives, held = {}, []
        for at in range(fields):
            signal = Signal(10.0, 2.0, 5, seed=seed * 100_003 + number * 101 + at)
            values = tuple(signal.value(index) for index in range(len(in_times)))
            drives[f"ext{at}"] = FieldDrive(Series(in_times, values), signal)
            held.append((np.asarray(values[::rate]) - 10.0) / 2.0)
        runs.append(Run(drives, {"unit:y": Series(out_times, tuple(response(held, rng).tolist()))}))
    return runs


def delayed(values, lag):
    return np.concatenate([np.full(lag, values[0]), values])[: len(values)]


def names(result):
    return {edge.external for edge in result.permeable()}


def test_finds_linear_even_and_spread_effects_with_lag_and_strength():
    def response(held, rng):
        level = delayed(held[0], 3) + 1.2 * np.abs(held[1])
        return 1e6 + 50 * (level + 0.5 * rng.normal(size=SAMPLES) * np.exp(1.2 * held[2]))

    result = analyse(make_runs(8, response))
    edges = {edge.external: edge for edge in result.permeable()}
    assert set(edges) == {"ext0", "ext1", "ext2"}
    assert edges["ext0"].lag_s == pytest.approx(0.3, abs=0.05)
    assert edges["ext2"].effect == "spread"
    assert 0.2 < edges["ext0"].strength < 0.7
    assert all(0 <= edge.low <= edge.strength <= edge.high <= 1 for edge in result.edges)
    assert all(edge.permeable or edge.low == 0 for edge in result.edges)  # no effect was shown, so none is claimed
    assert len(result.edges) == 8
    assert all(edge.p_value > 0.05 for edge in result.edges if not edge.permeable)


def test_the_share_that_would_have_shown_is_told_where_nothing_was_found():
    count = 24

    def edge(share, seed):
        """One value a run of ten fields, the first of which has this share."""
        rng, times = np.random.default_rng(seed), tuple(map(float, range(count)))
        signals = {f"ext{at}": Signal(0.0, 1.0, 1, seed=seed * 101 + at) for at in range(10)}
        drives = {
            name: FieldDrive(Series(times, tuple(map(signal.value, range(count)))), signal)
            for name, signal in signals.items()
        }
        values = np.sqrt(3 * share) * np.asarray(drives["ext0"].series.values)
        values = values + np.sqrt(1 - share) * rng.normal(size=count)
        result = analyse([Run(drives, {"unit:y": Series(times, tuple(values.tolist()))})], lags=1, alpha=0.01)
        return next(one for one in result.edges if one.external == "ext0")

    told = float(np.median([one.detectable for one in (edge(0.0, seed) for seed in range(12)) if not one.permeable]))
    assert 0.3 < told < 0.6
    found = [np.mean([edge(times * told, seed).permeable for seed in range(12)]) for times in (0.3, 1.6)]
    assert found[0] <= 0.2
    assert found[1] >= 0.8
    assert edge(0.99, 0).detectable is None


def test_benchmark_table_power_and_false_discoveries():
    def response(held, rng):
        noise = np.zeros(SAMPLES)
        for at in range(1, SAMPLES):
            noise[at] = 0.7 * noise[at - 1] + 0.7 * rng.normal()
        level = 0.8 * delayed(held[0], 2) + 0.5 * delayed(held[1], 3) + 1.4 * np.abs(held[3])
        return level + 0.6 * noise * np.exp(1.2 * held[2])

    found = [names(analyse(make_runs(8, response, fields=12, seed=seed), seed=seed)) for seed in range(8)]
    real = {f"ext{at}" for at in range(4)}
    assert np.mean([len(one & real) / 4 for one in found]) > 0.9
    assert np.mean([len(one - real) / max(len(one), 1) for one in found]) < 0.08


def test_false_edges_are_rare_for_a_random_walk_without_any_effect():
    def response(_, rng):
        return np.cumsum(rng.normal(size=SAMPLES))

    found = [bool(names(analyse(make_runs(4, response, seed=seed), seed=seed, draws=99))) for seed in range(24)]
    assert sum(found) <= 5


def test_integrated_effect_is_found():
    found = names(analyse(make_runs(6, lambda held, rng: np.cumsum(held[0] + rng.normal(size=SAMPLES)))))
    assert found == {"ext0"}


@pytest.mark.parametrize("rate", [5, 10])
def test_fast_inputs_are_seen_between_output_samples(rate):
    # A delay of less than one output sample, in which a fast input has changed its value several times.
    runs = make_runs(6, lambda _, rng: rng.normal(size=SAMPLES), rate=rate)
    changed = []
    for run in runs:
        series = run.inputs["ext0"].series
        late = np.interp(np.asarray(run.outputs["unit:y"].times) - 0.05, series.times, series.values)
        noise = np.asarray(run.outputs["unit:y"].values)
        values = tuple((late + 0.3 * noise).tolist())
        changed.append(Run(run.inputs, {"unit:y": Series(run.outputs["unit:y"].times, values)}))
    (edge,) = analyse(changed).permeable()
    assert edge.external == "ext0"
    assert edge.lag_s == pytest.approx(0.05, abs=0.045)


def test_robust_against_missing_short_constant_and_uneven_series():
    runs = make_runs(8, lambda held, rng: held[0] + 0.3 * rng.normal(size=SAMPLES))
    full = runs[3].outputs["unit:y"]
    runs[0] = Run(runs[0].inputs, {})
    runs[1] = Run(runs[1].inputs, {"unit:y": Series((0.0, 0.1), (1.0, 2.0))})
    runs[2] = Run(runs[2].inputs, {"unit:y": Series(full.times, (7.0,) * SAMPLES)})
    runs[3] = Run(runs[3].inputs, {"unit:y": Series(full.times[:25], full.values[:25])})
    broken = (float("nan"), float("inf"), 1e300, *runs[4].outputs["unit:y"].values[3:])
    runs[4] = Run(runs[4].inputs, {"unit:y": Series(full.times, broken), "unit:dead": Series()})
    runs[5] = Run({name: drive for name, drive in runs[5].inputs.items() if name != "ext0"}, runs[5].outputs)
    constant = FieldDrive(Series((0.0, 1.0), (3.0, 3.0)), Signal(3.0, 0.0))
    runs[6] = Run({**runs[6].inputs, "constant": constant}, runs[6].outputs)
    result = analyse(runs)
    assert names(result) == {"ext0"}
    assert {(one.external, one.internal) for one in result.skipped} >= {("constant", "unit:y"), ("ext0", "unit:dead")}
    assert all(one.reason for one in result.skipped)


def test_one_value_per_run_is_a_single_run_with_one_sample_per_system_run():
    rng = np.random.default_rng(3)
    times = tuple(float(at) for at in range(96))
    signals = [Signal(0.0, 1.0, 1, seed=at) for at in range(6)]
    drives = {
        f"ext{at}": FieldDrive(Series(times, tuple(signal.value(index) for index in range(96))), signal)
        for at, signal in enumerate(signals)
    }
    output = np.asarray(drives["ext2"].series.values) + 0.5 * rng.normal(size=96)
    result = analyse([Run(drives, {"unit:y": Series(times, tuple(output.tolist()))})], lags=1)
    assert names(result) == {"ext2"}


def test_a_field_whose_first_value_counts_is_suspected_and_few_others_are():
    def response(held, rng):
        return held[0][0] + 0.3 * held[1] + 0.1 * rng.normal(size=SAMPLES)

    suspected = [
        (at, may_latch(make_runs(8, response, seed=seed), f"ext{at}", "unit:y"))
        for seed in range(40)
        for at in range(8)
    ]
    assert all(one for at, one in suspected if at == 0)
    assert sum(one for at, one in suspected if at) <= 5  # of 280, each with a chance of 0.002
    assert not may_latch(make_runs(3, response), "ext0", "unit:y")
    assert not may_latch(make_runs(8, lambda held, rng: np.full(SAMPLES, 5.0)), "ext0", "unit:y")
    assert not may_latch([Run({}, {"unit:y": Series((0.0,), (1.0,))})] * 8, "ext0", "unit:y")


def test_integer_signals_and_deterministic_answers():
    runs = make_runs(4, lambda held, rng: held[0] + rng.normal(size=SAMPLES))
    whole = Signal(1.0, 1.0, 5, seed=1, integer=True)
    times = runs[0].outputs["unit:y"].times
    drive = FieldDrive(Series(times, tuple(whole.value(at) for at in range(SAMPLES))), whole)
    runs = [Run({**run.inputs, "mode": drive}, run.outputs) for run in runs]
    seen = []
    first = analyse(runs, seed=4, progress=lambda *args: seen.append(args))
    assert first == analyse(runs, seed=4)
    assert seen == [(1, 1, "permeability of unit:y")]


def test_redrawn_correlations_equal_those_of_built_designs():
    rng = np.random.default_rng(0)
    times = np.arange(50) * 0.1
    grid = lag_grid(0.1, 0.1, lags=4)
    signal = Signal(0.0, 1.0, 5)
    index = grid.indices(times, times)
    part = RunColumns(slice(0, 50), index, np.zeros(50), signal, 2)
    drawn = part.redraw(1, np.random.default_rng([1, 2, 0]))[0][part.blocks()]
    response = rng.normal(size=(50, 2))
    response -= response.mean(axis=0)
    fast = LagColumns(grid, 0.1, (part,), 50).correlate_draws(response, draws=1, seed=(1, 2))
    slow = LagColumns(grid, 0.1, (RunColumns(slice(0, 50), index, drawn, signal, 2),), 50).correlate(response)
    np.testing.assert_allclose(fast, slow, rtol=1e-9)


def test_when_every_field_shows_the_search_is_over():
    result = analyse(make_runs(4, lambda held, rng: held[0] + 0.1 * rng.normal(size=SAMPLES), fields=1))
    assert names(result) == {"ext0"}
    assert len(result.edges) == 1


def test_no_runs_and_bad_numbers():
    assert analyse([]).edges == ()
    with pytest.raises(ValueError, match="positive"):
        analyse([], lags=0)
    assert not standardise(np.full(10, 0.1)).any()


def test_what_is_doubtful_is_permeable_only_where_other_runs_show_it_too():
    def result(p_value, **edges):
        return PermeabilityResult(
            tuple(
                PermeabilityEdge(name, "unit:y", 0.5, low, 0.9, 0.0, p_value, permeable)
                for name, (low, permeable) in edges.items()
            )
        )

    first = result(0.01, clear=(0.1, True), chance=(0, True), weak=(0, True), faint=(0.1, True), none=(0, False))
    fresh = result(0.3, clear=(0, False), chance=(0, False), weak=(0, True), faint=(0, False), none=(0, True))
    together = result(0.02, clear=(0.1, True), chance=(0.1, True), weak=(0, True), faint=(0, True), none=(0.1, True))
    assert [edge.external for edge in first.doubtful()] == ["chance", "weak"]
    judged = first.confirmed_by(fresh, together)
    assert names(judged) == {"clear", "weak"}
    assert {edge.external: edge.p_value for edge in judged.edges} == {
        "clear": 0.02, "weak": 0.02, "chance": 0.3, "faint": 0.3, "none": 0.3
    }  # fmt: skip
