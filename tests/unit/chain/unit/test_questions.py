from __future__ import annotations

import itertools
import random
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.campaign.confirm import CONFIRMATIONS
from riot_bus.chain.unit.questions import FreshCases, UnitQuestions, json_value, measured_rate, noise_of
from riot_bus.findings.records import FieldsRecord, FindingRecord, MinimalRecord, ProportionRecord
from riot_bus.statistics.rates import exact_interval
from riot_bus.vocabulary.errors import InconclusiveError
from tests.unit.chain.machine import MODE, SPEED, bench, rated, sometimes, write_fields, write_minimal


def test_values_of_bytes_are_hex() -> None:
    assert [json_value(value) for value in (b"\x00\xff", 1.5, "x", True)] == ["00ff", 1.5, "x", True]


def test_one_trial_decides_where_the_failure_is_reliable(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    rated(one, 4, 4)
    questions = UnitQuestions(one.run(), one.folder)
    asked = [{SPEED: -1.0}, {SPEED: 5.0}, {MODE: "hold"}, {SPEED: -1.0}]
    assert questions.ask(asked) == [True, False, False, True]
    assert questions.ask(asked[1:]) == [False, False, True]
    assert [case.again for case in one.machine.executed] == [0, 0, 0]


@pytest.mark.parametrize("unprobed", [True, False])
def test_trials_are_probed_as_those_of_the_minimal_log(tmp_path: Path, unprobed: bool) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    MinimalRecord.load(one.folder).model_copy(update={"unprobed": unprobed}).save(one.folder)
    UnitQuestions(one.run(), one.folder).ask([{SPEED: -1.0}])
    (case,) = one.machine.executed
    assert case.unprobed == unprobed
    assert case.digest() != replace(case, unprobed=not unprobed).digest()


def test_what_fails_sometimes_is_decided_by_as_many_trials_as_it_takes(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=sometimes(0.3))
    write_minimal(one)
    rated(one, 6, 20)
    questions = UnitQuestions(one.run(), one.folder)
    asked = [{SPEED: number / 4 - 5} for number in range(48)]
    wrong = [value for value, answer in zip(asked, questions.ask(asked), strict=True) if answer != (value[SPEED] < 1)]
    assert len(wrong) <= 4
    assert 3 * len(asked) < len(one.machine.executed) < 12 * len(asked)
    cases = [questions.case(value) for value in wrong]
    assert sum(questions.decide(cases, doubt=0.002)) == sum(value[SPEED] < 1 for value in wrong)


@pytest.mark.parametrize(("confirmed", "rate"), [(3, 1.0), (1, 0.3)])
def test_a_rate_is_measured_if_certificates_do_not_always_fail(tmp_path: Path, confirmed: int, rate: float) -> None:
    """By chance, both trials of the minimal log have failed."""
    one = bench(tmp_path, wrong=sometimes(rate))
    write_minimal(one)
    MinimalRecord.load(one.folder).model_copy(update={"failed": (2, 2)}).save(one.folder)
    write_fields(one, SPEED)
    questions = UnitQuestions(one.run(), one.folder)
    assert questions.noise.rate > 0.95
    certificates = [field.certificate for field in FieldsRecord.load(one.folder).fields]
    questions.measure([each.model_copy(update={"confirmed_failing": confirmed}) for each in certificates])
    assert questions.noise.rate == pytest.approx(rate, abs=0.1)
    assert len(one.machine.executed) == 0 if rate == 1 else 20 < len(one.machine.executed) <= 120


@pytest.mark.parametrize("rate", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_intervals_of_measured_rates_hold_what_they_claim(rate: float) -> None:
    """Of 2,000 intervals of 95 %, 1,876 hold the rate with 99 % probability even where each holds it with 95 % only."""
    chance = random.Random(3)
    found = [measured_rate(lambda: [chance.random() < rate for _ in range(2)]) for _ in range(2000)]
    assert sum(low <= rate <= high for low, high in itertools.starmap(exact_interval, found)) >= 1876
    assert all(12 <= total <= 120 for _, total in found)


def test_what_comes_too_seldom_is_inconclusive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.chain.unit.questions._MOST_TRIALS", 30)
    one = bench(tmp_path, wrong=sometimes(0.1))
    write_minimal(one)
    rated(one, 2, 20)
    questions = UnitQuestions(one.run(), one.folder)
    with pytest.raises(InconclusiveError, match="30 trials have not told when it fails"):
        questions.ask([{SPEED: float(number)} for number in range(-20, 20)])


def test_nominal_values_are_thinned_out(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    questions = UnitQuestions(one.run(), one.folder)
    values = questions.nominal(questions.fields.fields.values(), at_most=20)
    assert {name: len(some) for name, some in values.items()} == {MODE: 20, SPEED: 20, "command:note": 20}


def test_fresh_cases_are_new_trials_each_time_and_the_store_knows_them(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    case = UnitQuestions(one.run(), one.folder).case({SPEED: -1.0})
    for _ in range(2):
        cases = FreshCases(one.run().unit_runner("drive"))
        cases.run([case, case])
        cases.run([case])
    numbers = [each.again for each in one.machine.executed]
    assert numbers == [0, CONFIRMATIONS + 1, CONFIRMATIONS + 2]
    assert cases.parallelism == 4


def test_what_a_campaign_has_shown_of_the_rate_is_taken_in(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    finding = FindingRecord.load(one.folder)
    rare = ProportionRecord(value=0.3, low=0.1, high=0.6, count=3, total=10)
    assert noise_of(finding.model_copy(update={"rate": rare})).rate < 0.5 < noise_of(finding).rate
    never = ProportionRecord(value=0, low=0, high=0.1, count=0, total=40)
    never_falsely, unknown = noise_of(finding.model_copy(update={"nominal": never})), noise_of(finding)
    assert never_falsely.weight @ never_falsely.eps < unknown.weight @ unknown.eps


def test_the_rate_is_that_of_the_minimal_log_where_it_is_known(tmp_path: Path) -> None:
    """The case of a campaign may have many causes of the failure, and so fail more often."""
    one = bench(tmp_path)
    write_minimal(one)
    rated(one, 4, 4)
    minimal = MinimalRecord.load(one.folder).model_copy(update={"failed": (4, 13)})
    assert noise_of(FindingRecord.load(one.folder)).rate > 0.95
    assert noise_of(FindingRecord.load(one.folder), minimal).rate < 0.5
    minimal.save(one.folder)
    assert UnitQuestions(one.run(), one.folder).noise.rate < 0.5
