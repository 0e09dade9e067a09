from __future__ import annotations

import math
import random
import tomllib
from itertools import combinations

import pytest

from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from riot_bus_logtools.comparison.compare import Wishes, compare
from riot_bus_logtools.comparison.parts import FieldDifference, FieldExample
from riot_bus_logtools.comparison.proposal import margin_of, propose
from tests.unit.riot_bus_logtools.comparison.recordings import recording, said, told


def proposed(*runs):
    """What is proposed from runs with these rows, by name."""
    logs = [recording(said(*rows), str(number)) for number, rows in enumerate(runs)]
    return propose(
        [log.name for log in logs],
        lambda tolerances: [compare(a, b, Wishes(tolerances=tolerances)) for a, b in combinations(logs, 2)],
    )


def values(found):
    return {each.name: each.value for each in found.tolerances}


def runs_of(count, make):
    return [[make(run, random.Random(f"{run}:{place}"), place) for place in range(200)] for run in range(count)]


def test_equal_runs_need_nothing():
    found = proposed(*([{"x": 1}] * 5 for _ in range(3)))
    assert (found.tolerances, found.pairs, found.messages) == ((), 3, 15)
    found.check()


def test_numbers_get_the_largest_difference_times_a_margin():
    found = proposed([{"x": 1.0}] * 4, [{"x": 1.0}, {"x": 1.25}, {"x": 1.0}, {"x": 1.0}])
    assert values(found) == {"a:x": pytest.approx(0.25 * margin_of(2), rel=0.05)}
    assert found.tolerances[0].reason.startswith(
        "differs in 1 of 4 messages, by 0.25 at most, times 5; its values are 1 to 1.25"
    )
    found = proposed(*([{"n": 10 * place + (place == run)} for place in range(9)] for run in range(5)))
    assert values(found) == {"a:n": 2}


def test_the_margin_is_wider_the_fewer_runs_there_are():
    assert [margin_of(number) for number in (2, 3, 4, 5, 6, 50)] == [5.0, 7.3, 3.7, 2.7, 2.2, 2.0]


def differences(largest, *, turns, typical=None):
    """What a field differs by in pairs of runs."""
    example = FieldExample("x", 0, 0, 0.0, 0.0, 1.0)
    return [
        FieldDifference("x", 9, example, largest=one, typical=one if typical is None else typical, turns=turn)
        for one, turn in zip(largest, turns, strict=True)
    ]


def test_noise_within_runs_needs_less_than_what_each_run_has_its_own_of():
    assert margin_of(3, differences([1.0, 1.2, 0.9], turns=[0.5, 0.4, 0.6]), pairs=3) == 2.0
    assert margin_of(3, differences([1.0, 1.2, 0.9], turns=[0.5, 0.1, 0.6]), pairs=3) == 7.3
    assert margin_of(3, differences([1.0, 2.0, 1.0], turns=[0.5] * 3), pairs=3) == 7.3
    assert margin_of(3, differences([1.0, 1.0], turns=[0.5] * 2), pairs=3) == 7.3
    assert margin_of(2, differences([1.0], turns=[0.5]), pairs=1) == 5.0
    offset = proposed(*runs_of(3, lambda run, rng, place: {"x": place + 0.01 * run + rng.random() / 1e4}))
    noise = proposed(*runs_of(3, lambda run, rng, place: {"x": place + rng.uniform(-1, 1)}))
    assert [found.tolerances[0].reason.partition("times ")[2][:3] for found in (offset, noise)] == ["7.3", "2; "]


@pytest.mark.parametrize(("runs", "margin"), [(2, 20.0), (3, 20.0), (8, 10.0), (15, 6.5)])
def test_what_grows_and_shrinks_in_a_run_needs_more_than_an_offset(runs, margin):
    assert margin_of(runs, differences([1.0, 1.0, 1.0], turns=[0.02] * 3, typical=0.2), pairs=3) == margin


def test_runs_that_wander_are_not_taken_for_noise_though_all_pairs_differ_by_the_same():
    turn = 2 * math.pi / 3
    found = proposed(*runs_of(3, lambda run, rng, place: {"x": place + math.sin(place / 30 + run * turn)}))
    assert "times 20" in {each.name: each.reason for each in found.tolerances}["a:x"]
    assert values(found)["a"] == 2  # messages at the ends


def test_texts_and_fields_that_are_not_always_there_are_ignored():
    found = proposed([{"t": "a", "x": 1}] * 3, [{"t": "b", "x": 1, "y": 2}] * 3)
    assert values(found) == {"a:t": "ignore", "a:y": "ignore"}
    assert 'such as "a" and "b"' in found.tolerances[0].reason


def test_numbers_that_are_drawn_anew_are_ignored():
    found = proposed(*runs_of(3, lambda run, rng, place: {"id": rng.getrandbits(48), "x": rng.gauss(0, 1), "n": place}))
    assert values(found)["a:id"] == "ignore"
    assert isinstance(values(found)["a:x"], float)
    assert "as if drawn anew" in {each.name: each.reason for each in found.tolerances}["a:id"]


def test_what_every_run_has_its_own_of_is_ignored():
    found = proposed(*runs_of(3, lambda run, rng, place: {"offset": 100.0 * run + rng.random() / 100, "n": place}))
    assert values(found) == {"a:offset": "ignore"}


def test_nan_in_one_run_alone():
    assert values(proposed([{"x": 1.0}], [{"x": float("nan")}])) == {"a:x": "ignore"}


def test_elements_of_arrays_get_one_tolerance():
    found = proposed([{"r": [1.0, 2.0]}] * 3, [{"r": [1.0, 2.5]}] * 3)
    assert list(values(found)) == ["a:r[*]"]
    found = proposed([{"r": [1, 2]}] * 9, [{"r": [1, 2]}] * 8 + [{"r": [1, 2, 3]}])
    assert (values(found)["a:len(r)"], values(found)["a:r[*]"]) == (5, "ignore")


def test_times_need_no_tolerance():
    assert values(proposed(*([{"x": 1, "stamp": run}] * 3 for run in range(3)))) == {}


def test_counts_of_messages():
    rows = [{"n": number} for number in range(40)]
    found = proposed(rows, rows[:20] + rows[21:], rows)
    assert values(found) == {"a": 8}
    assert found.tolerances[0].reason == "1 were lost, added or out of order at most, times 7.3; there are 39 to 40"


def test_what_is_within_the_range_is_told_apart_from_what_is_not():
    found = proposed(*runs_of(3, lambda run, rng, place: {"x": rng.uniform(-1, 1), "y": place + rng.gauss(0, 0.01)}))
    reasons = {each.name: each.reason for each in found.tolerances}
    assert reasons["a:x"].endswith("so it finds gross changes alone")
    assert "gross" not in reasons["a:y"]


def noisy(run, rng, place):
    return {
        "x": place * 0.1 + rng.gauss(0, 0.01),
        "id": rng.getrandbits(40),
        "stamp": 1e9 * run + place,
        "mode": place % 3,
    }


def test_held_out_runs_are_the_same_and_a_changed_field_is_found():
    found = proposed(*runs_of(3, noisy))
    held = [[noisy(run, random.Random(f"{run}:{place}"), place) for place in range(200)] for run in range(100, 140)]
    pairs = list(zip(held[::2], held[1::2], strict=True))
    given = found.given()
    assert all(compare(recording(said(*a)), recording(said(*b)), Wishes(tolerances=given)).same for a, b in pairs)
    a, b = pairs[0]
    for field, value in (("x", 10.0), ("mode", 7)):
        other = [{**row, field: value} if place == 150 else row for place, row in enumerate(b)]
        (topic,) = compare(recording(said(*a)), recording(said(*other)), Wishes(tolerances=given)).topics
        assert [(each.name, each.example.a) for each in topic.fields] == [(field, 150)]


def test_a_file_says_why(tmp_path):
    found = proposed([{"t": "a\n]", 'k"]': 1}], [{"t": "b", 'k"]': 2}])
    found.write(tmp_path / "t.toml")
    text = (tmp_path / "t.toml").read_text(encoding="utf-8")
    assert "# differs in 1 of 1 message, and is no number in 1 of them, such as" in text
    assert tomllib.loads(text) == {"tolerances": values(found)}
    assert told(
        said({"t": "a", 'k"]': 1}), said({"t": "b", 'k"]': 2}), *(f"{k}={v}" for k, v in values(found).items())
    ).same
    with pytest.raises(ConfigError, match="cannot write"):
        found.write(tmp_path / "none" / "t.toml")


def test_names_of_logs_stay_in_their_comment():
    found = propose(["a\nb = 1", "c"], lambda _: [told(said(b"1"), said(b"1"))])
    assert tomllib.loads(found.toml()) == {"tolerances": {}}


def test_what_still_differs_is_told(monkeypatch):
    rows = [{"n": number} for number in range(30)]
    other = [message.with_(encoding="text/json") for message in said(*rows)]
    found = propose(
        ["a", "b"],
        lambda tolerances: [compare(recording(said(*rows)), recording(other), Wishes(tolerances=tolerances))],
    )
    assert found.unsettled == ("a",)
    assert "# NOT SETTLED: a" in found.toml()
    with pytest.raises(InconclusiveError, match="still differ in a"):
        found.check()


def test_nothing_to_learn_from():
    found = propose(["a", "b"], lambda _: [told(said(b"1"), said(b"1", key="b"))])
    with pytest.raises(InconclusiveError, match="no two of these logs"):
        found.check()


def test_json_and_lines():
    found = proposed([{"x": 1.0}], [{"x": 2.0}])
    assert found.to_json()["tolerances"] == [{"name": "a:x", "value": 5.0, "reason": found.tolerances[0].reason}]
    first, second = found.lines()
    assert first == "1 tolerance from 1 pair of messages of 2 logs (1 pair)"
    assert second.startswith("  a:x = 5.0  (differs in 1 of 1 message")
