from __future__ import annotations

from pathlib import Path

from riot_bus.campaign.confirm import CONFIRMATIONS
from riot_bus.chain.questions import FreshCases, UnitQuestions, json_value, noise_of
from riot_bus.findings.records import FindingRecord, ProportionRecord
from riot_bus.vocabulary.trial import Verdict
from tests.unit.chain.machine import MODE, SPEED, bench, said, write_minimal


def test_values_of_bytes_are_hex() -> None:
    assert [json_value(value) for value in (b"\x00\xff", 1.5, "x", True)] == ["00ff", 1.5, "x", True]


def test_repetitions_are_trials_of_their_own(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: case.seed == 2)
    write_minimal(one)
    questions = UnitQuestions(one.run(), one.folder)
    assert questions.ask([{SPEED: -1.0}, {SPEED: 5.0}, {MODE: "hold"}]) == [True, False, False]
    slow, fast = questions.repeat([{SPEED: -1.0}, {SPEED: 5.0}], range(1, 4))
    assert [outcome.verdict for outcome in slow] == [Verdict.FAIL, Verdict.PASS, Verdict.FAIL]
    assert list(map(questions.failed, fast)) == [False, True, False]
    assert [case.seed for case in one.machine.executed] == [0, 0, 0, 1, 2, 3, 1, 2, 3]


def test_answers_that_are_contradicted_are_corrected_and_the_search_is_done_again(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: case.seed == 0 and said(case.messages[0])["speed"] == 7.0)
    write_minimal(one)
    questions = UnitQuestions(one.run(), one.folder)
    asked = [{SPEED: -1.0}, {SPEED: 7.0}]
    rounds = []

    def contradicted(found: list[bool]) -> list:
        rounds.append(found)
        return [] if found == [True, False] else [({SPEED: 7.0}, False)]

    assert questions.settle(lambda: questions.ask(asked), contradicted, rounds=3) == [True, False]
    assert rounds == [[True, True], [True, False]]
    assert len(one.machine.executed) == 2


def test_what_the_last_of_several_rounds_finds_stands(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    questions = UnitQuestions(one.run(), one.folder)
    found = iter("abc")
    assert questions.settle(lambda: next(found), lambda name: [({SPEED: 1.0}, True)], rounds=2) == "b"
    assert questions.ask([{SPEED: 1.0}]) == [True]


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
    assert noise_of(finding.model_copy(update={"nominal": never})).false_rate < noise_of(finding).false_rate
