from __future__ import annotations

import sys

import numpy as np
import pytest

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.proposers import Simplex
from riot_bus.vocabulary.errors import MissingExtraError
from tests.tiers import scaled


def rover_fields(irrelevant=0):
    return [
        SearchField("goal.x", 2.0, 1.0, -5000, 5000),
        SearchField("goal.y", 3.0, 1.0, -5000, 5000),
        SearchField("vx", 0.5, 0.2, -5000, 5000),
        SearchField("vy", 0.0, 0.2, -5000, 5000),
        *(SearchField(f"other{at}", 0.0, 1.0, -5000, 5000) for at in range(irrelevant)),
    ]


def rover(points, zone=80.0):
    """The crash zone of the paper: 20 m deep at the lower edge of a map of +-100 m; goals off the map are refused."""
    answers = []
    for point in points:
        x, y = point["goal.x"], point["goal.y"]
        if abs(x) >= 100 or abs(y) >= 100:
            answers.append(Evaluation(None, failed=False))
            continue
        y0 = y + zone - float(np.clip(point["vy"], -2, 2)) * 1.0
        answers.append(Evaluation(max(y0, 0.0), failed=y0 < 0))
    return answers


def test_rover_is_activated_within_200_runs_for_nearly_every_seed():
    runs = [activate(rover_fields(), rover, seed=seed) for seed in range(scaled(30))]
    solved = [one.runs for one in runs if one.found is not None]
    assert len(solved) >= len(runs) - 2
    assert np.median(solved) <= 60
    assert rover([runs[0].found])[0].failed
    assert "activated after" in runs[0].text


@pytest.mark.parametrize("parallelism", [1, 4])
def test_equal_seeds_and_answers_give_equal_searches_without_repeats(parallelism):
    batches = []

    def asked(points):
        batches.append(len(points))
        return rover(points, zone=99.0)

    first = activate(rover_fields(), asked, seed=5, budget=50, parallelism=parallelism)
    again = activate(rover_fields(), asked, seed=5, budget=50, parallelism=parallelism)
    assert first == again
    assert max(batches) == parallelism
    points = [tuple(point.items()) for point, _ in first.history]
    assert len(set(points)) == len(points)


def test_what_failed_elsewhere_is_tried_first_and_counts_for_nothing_else():
    known = [{"goal.y": -95.0, "wind": 3.0}, {"goal.y": -96.0}]
    found = activate(rover_fields(), rover, seed=0, promising=known)
    assert found.runs == 1
    assert found.found == {"goal.x": 2.0, "goal.y": -95.0, "vx": 0.5, "vy": 0.0}
    misled = activate(rover_fields(), rover, seed=0, promising=[{"goal.y": float(at)} for at in range(9)])
    assert [point["goal.y"] for point, _ in misled.history[:4]] == [0, 1, 2, 3]
    assert misled.found is not None
    none = [{"goal.y": 5001.0}, {"goal.y": float("nan")}, {"vx": float("inf")}]
    assert activate(rover_fields(), rover, seed=0, promising=none) == activate(rover_fields(), rover, seed=0)


def test_stops_after_the_first_failing_batch_and_at_the_budget():
    result = activate(rover_fields(), lambda points: [Evaluation(None, failed=True) for _ in points], seed=0)
    assert result.runs == 1
    assert result.found == {"goal.x": 2.0, "goal.y": 3.0, "vx": 0.5, "vy": 0.0}
    seen = []
    never = activate(
        rover_fields(),
        lambda points: [Evaluation(None, failed=False) for _ in points],
        seed=0,
        budget=45,
        parallelism=4,
        progress=lambda *args: seen.append(args),
    )
    assert never.runs == 45
    assert never.found is None
    assert "never seen" in never.text
    assert seen[-1][:2] == (45, 45)


def test_a_rule_that_was_met_without_a_failure_is_told_without_a_guess():
    fields = rover_fields()
    met = activate(fields, lambda points: [Evaluation(-0.5, failed=False) for _ in points], seed=0, budget=7)
    assert met.text == "not activated in 7 runs, though the rule was met in 7 of them"
    near = activate(fields, lambda points: [Evaluation(0.5, failed=False) for _ in points], seed=0, budget=7)
    assert near.text == "not activated in 7 runs: the rule came no nearer than 0.5"


@pytest.mark.parametrize("distance", [3.0, 1e308, float("inf"), float("nan")])
def test_constant_distances_do_not_stop_the_search(distance):
    result = activate(
        rover_fields(), lambda points: [Evaluation(distance, failed=False) for _ in points], seed=1, budget=60
    )
    assert result.runs == 60
    assert "no nearer" in result.text or "never seen" in result.text


def test_one_field_and_exhausted_integers():
    field = SearchField("mode", 2.0, 1.0, 0, 6, integer=True)
    asked = []

    def evaluate(points):
        asked.extend(point["mode"] for point in points)
        return [Evaluation(1.0, failed=False) for _ in points]

    result = activate([field], evaluate, seed=0, budget=100)
    assert result.runs == len(asked) <= 7
    assert set(asked) <= set(range(7))


def test_encoding_is_symmetric_around_nominal_and_rounds_sensibly():
    field = SearchField("goal.x", 2.0, 1.0, -5000, 5000)
    assert field.encode(2.0) == 0.0
    assert field.decode(field.encode(1234.5678)) == 1235.0
    assert field.decode(field.encode(2.12345678)) == 2.123
    assert field.decode(99.0) == 5000.0
    encoding = Encoding((field,))
    assert encoding.decode(encoding.nominal)["goal.x"] == pytest.approx(2.0)


def test_useless_questions_are_refused():
    with pytest.raises(ValueError, match="spread"):
        SearchField("x", 0.0, 0.0, -1, 1)
    with pytest.raises(ValueError, match="range"):
        SearchField("x", 0.0, 1.0, 1, 1)
    with pytest.raises(ValueError, match="different names"):
        activate([], rover, seed=0)
    with pytest.raises(ValueError, match="budget"):
        activate(rover_fields(), rover, seed=0, budget=0)


@pytest.mark.parametrize(("module", "package"), [("sklearn.ensemble", "scikit-learn"), ("cmaes", "cmaes")])
def test_missing_extra_is_named(monkeypatch, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=package):
        activate(rover_fields(), lambda points: rover(points, zone=103.0), seed=0, budget=60)


class Corner:
    """A search method of somebody else's: goes straight to the upper corner."""

    def __init__(self, history, nominal, rng):
        self.asked = []
        self.size = len(nominal)

    def ask(self):
        if self.asked:
            return None
        self.asked.append(np.ones(self.size))
        return self.asked[0]

    def tell(self, vector, value):
        pass


def test_the_methods_that_are_named_do_the_search():
    fields = rover_fields()
    probes = 1 + 3 * 2 * len(fields)
    corner = {field.name: pytest.approx(field.high) for field in fields}

    def far(points):
        return [Evaluation(1.0, failed=False) for _ in points]

    for methods, found in (([Corner], True), ([Simplex], False)):
        result = activate(fields, far, seed=0, budget=probes + 1, methods=methods)
        assert (dict(result.history[probes][0]) == corner) == found
