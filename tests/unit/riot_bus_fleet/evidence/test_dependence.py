from __future__ import annotations

import numpy as np
import pytest

from riot_bus_fleet.evidence.alignment import held_variants, response_of
from riot_bus_fleet.evidence.dependence import dependences
from tests.unit.backchain.recordings import late, pieces, red


def told(logs, **options):
    response = response_of(logs, "out:v")
    names = sorted({name for one in logs for name in one.values} - {"out:v"})
    return {
        one.name: one for one in dependences(response, {n: held_variants(logs, n, response) for n in names}, **options)
    }


def found(logs, **options):
    return {name for name, one in told(logs, **options).items() if one.found}


def test_level_square_and_spread_are_found_with_their_lags_among_others():
    def make(rng, count):
        e = {f"e{at}": red(rng, count, 0.2 * (at % 5)) for at in range(8)}
        level = late(e["e0"], 3) + 1.2 * np.abs(late(e["e1"], 1))
        return e | {"out": level + 0.6 * rng.normal(size=count) * np.exp(0.8 * late(e["e2"], 1))}

    result = told(pieces(make, logs=6, count=400))
    assert {name for name, one in result.items() if one.found} == {"e0:v", "e1:v", "e2:v"}
    assert [result[f"e{at}:v"].follows for at in range(3)] == ["level", "level", "spread"]
    assert result["e0:v"].lag_s == pytest.approx(0.35)
    assert result["e1:v"].lag_s == pytest.approx(0.15)
    assert all(0 < one.low <= one.strength <= one.high <= 1 for one in result.values() if one.found)
    assert all(0 < one.detectable < 0.1 for one in result.values() if not one.found)


def test_what_follows_the_same_thing_is_no_driver():
    def make(rng, count):
        cause = red(rng, count)
        return {
            "cause": cause,
            "sibling": late(cause, 1) + 0.3 * red(rng, count),
            "out": late(cause, 2) + 0.3 * red(rng, count),
        }

    assert found(pieces(make)) == {"cause:v"}


def test_what_the_response_drives_itself_is_no_driver():
    def make(rng, count):
        cause, out = red(rng, count), red(rng, count)
        out = late(cause, 1) + out
        return {"cause": cause, "effect": late(out, 2) + 0.3 * red(rng, count), "out": out}

    assert found(pieces(make)) == {"cause:v"}


def test_both_ways_of_a_loop_are_found():
    def make(rng, count):
        out, back = np.zeros(count), np.zeros(count)
        for at in range(3, count):
            back[at] = 0.5 * back[at - 1] + 0.5 * out[at - 2] + 0.5 * rng.normal()
            out[at] = 0.5 * out[at - 1] - 0.5 * back[at - 3] + 0.5 * rng.normal()
        return {"back": back, "other": red(rng, count), "out": out}

    logs = pieces(make)
    assert found(logs) == {"back:v"}
    response = response_of(logs, "back:v")
    (one,) = dependences(response, {"out:v": held_variants(logs, "out:v", response)})
    assert one.found


@pytest.mark.parametrize("kind", ["walks", "activity", "start"])
def test_what_only_moves_at_the_same_times_is_not_followed(kind):
    def make(rng, count):
        active = np.convolve(rng.normal(size=count + 60), np.ones(61), "valid") > 0
        shapes = {
            "walks": lambda: np.cumsum(rng.normal(size=count)),
            "activity": lambda: np.cumsum(rng.normal(size=count) * active),
            "start": lambda: rng.normal() * np.exp(-np.arange(count) / 20) + 0.05 * rng.normal(size=count),
        }
        return {name: shapes[kind]() for name in ("e0", "e1", "e2", "e3", "out")}

    names = [
        name
        for seed in range(4)
        for name, one in told(pieces(make, seed=seed, count=200)).items()
        if one.follows == "level"
    ]
    assert len(names) <= 1


def test_one_coincidence_however_large_is_no_evidence():
    def make(rng, count):
        jump = np.where(np.arange(count) == count // 2, 50.0, 0.0)
        return {"e": late(jump, 0) + rng.normal(size=count), "out": late(jump, 1) + rng.normal(size=count)}

    assert found(pieces(make, logs=1)) == set()


def test_too_few_messages_promise_nothing():
    def make(rng, count):
        return {"e": rng.normal(size=count), "out": rng.normal(size=count)}

    (one,) = told(pieces(make, logs=1, count=45)).values()
    assert not one.found
    assert one.detectable is None


def test_nothing_is_asked_of_no_candidates():
    assert dependences(response_of(pieces(lambda rng, n: {"out": red(rng, n)}), "out:v"), {}) == []
