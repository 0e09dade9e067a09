"""The cases of the judge, as far as that can be seen without their programs."""

from __future__ import annotations

import json
import math
import re

import pytest

from benchmarks.ablation import ROOT, changed, rows, scaled
from benchmarks.real_faults.case import Case, all_cases, form_of, has_form, messages_of
from benchmarks.real_faults.function import TruthRunner
from benchmarks.real_faults.page import page
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import TestCase

CASES = {case.name: case for case in all_cases()}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_case_is_small_and_its_truth_agrees_with_itself(case: Case) -> None:
    assert len((case.folder / "node.py").read_text().splitlines()) <= 40
    assert 60 <= len(case.nominal) <= 120
    assert not case.fails(case.nominal)
    assert case.verdict(messages_of(case.nominal)) == ("", len(case.nominal))
    if case.has_truth:
        edges = list(case.truth.edges())
        assert {fails for fails, _ in edges} == {True, False}
        assert [case.fails(log) for _, log in edges] == [fails for fails, _ in edges]


def test_enough_cases_of_enough_packages_and_kinds() -> None:
    faults = [case.file for case in CASES.values() if case.has_truth]
    assert len(faults) >= 26
    assert len({package.partition("==")[0] for each in faults for package in each.packages[:1]}) >= 20
    assert len({each.kind for each in faults}) >= 12
    assert sum(not case.has_truth for case in CASES.values()) >= 10


@pytest.mark.parametrize(
    ("value", "same"),
    [
        ({"a": 1.5, "b": [], "c": "y"}, True),
        ({"a": math.nan, "b": [1, 2.5], "c": ""}, True),
        ({"a": 1.5, "b": []}, False),
        ({"a": True, "b": [], "c": "y"}, False),
        ({"a": "1", "b": [], "c": "y"}, False),
        ({"a": 1, "b": [None], "c": "y"}, False),
        ([], False),
    ],
)
def test_forms(value: object, *, same: bool) -> None:
    assert has_form(value, form_of({"a": 1, "b": [3], "c": "x"})) is same


def test_the_truth_answers_trials() -> None:
    utm = CASES["utm"]
    nominal = tuple(messages_of(utm.nominal))
    asked = [
        TestCase(nominal),
        TestCase(nominal, (Injection("fix", "lon", 180.0, first=3, last=3),)),
        TestCase((*nominal[:2], nominal[2].with_(payload=b"{"))),
    ]
    outcomes = TruthRunner(utm).run(asked)
    assert [[each.signature for each in outcome.violations] for outcome in outcomes] == [
        [],
        ["crash in node: the report's fault"],
        ["crash in node: a payload of another form"],
    ]
    assert outcomes[1].statistics["delivered"] == [1]


def test_the_page_says_first_where_a_peer_was_better() -> None:
    missed = {"met": False, "trials": 104, "tried": 9, "coverable": 9, "findings": [], "wrong": ["all tried"]}
    peers = {"hypothesis": {"met": True, "runs": 7, "seconds": 1.0, "failures": ["raised"], "said": ""}}
    one = {"name": "utm", "kind": "one value", "test_s": 2.0, "seconds": 3.0, "load": 1.0, "grade": missed, "twin": {}}
    about = {"date": "today", "commit": "c", "cpus": 2, "python": "3", "seconds": 60.0, "seed": 0}
    saved = json.loads(json.dumps({"about": about, "results": [{**one, "peers": peers, "error": ""}]}))
    text = page(saved, list(CASES.values()))
    assert text.splitlines()[2].startswith(
        "Peers met what riot missed in the same time: utm (hypothesis). riot met 0 of 1"
    )
    assert "| utm | one value | **no** |" in text
    assert "| utm | Turbo87/utm#109 | utm==0.7.0 |" in text


def test_what_is_said_of_other_software_is_what_was_measured() -> None:
    saved = json.loads((ROOT / "benchmarks/real_faults/before.json").read_text(encoding="utf-8"))
    text = page(saved, list(CASES.values()))
    assert (ROOT / "docs/real-software.md").read_text(encoding="utf-8") == text
    met, of, explained = re.search(r"riot met (\d+) of (\d+) faults and explained (\d+)", text).groups()  # type: ignore[union-attr]
    said = f"of {of} public faults riot met {met} and explained {explained if int(explained) else 'none'}"
    assert said in " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())


def test_rows_of_the_ablation_are_changes_of_the_source() -> None:
    for number, row in enumerate(rows()):
        if row.body or number % 20 == 19:
            before = (ROOT / "riot_bus" / row.file).read_text(encoding="utf-8")
            assert compile(changed(before, row), row.file, "exec")
    assert [scaled(each, 0.5) for each in (1, -1, 7, 0.8, (2, 4.0))] == [1, -1, 4, 0.4, (1, 2.0)]
    assert [scaled(each, 2.0) for each in (3, 0.8, 1.5)] == [6, 1.0, 3.0]
