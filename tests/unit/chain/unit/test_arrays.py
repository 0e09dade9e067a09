"""Relevant elements of arrays: the whole array is varied, and the rule says whether one or any of them matters."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.steps.relevance import relevance
from riot_bus.chain.steps.rules import rules
from riot_bus.chain.unit.prediction import predict
from riot_bus.findings.records import MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.interceptors.guard import RuleGuard
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import Bench, bench, rated, said, write_finding


def path(poses: Sequence[float], number: int = 0) -> Message:
    payload = json.dumps({"poses": [{"x": x, "y": 1.5} for x in poses], "mode": "step"}).encode()
    return Message(10**18 + number * 50_000_000, "command", payload, sequence=number)


def fails_where(holds: Callable[[list[Any]], bool]) -> Callable[[Sequence[Message]], int | None]:
    def fails(messages: Sequence[Message]) -> int | None:
        for place, message in enumerate(messages):
            try:
                if holds([pose["x"] for pose in said(message)["poses"]]):
                    return place
            except (ValueError, KeyError, TypeError):
                continue
        return None

    return fails


def learnt(tmp_path: Path, holds: Callable[[list[Any]], bool], before: float = 2.0) -> tuple[Bench, RuleRecord]:
    one = bench(tmp_path, fails=fails_where(holds))
    write_finding(one, [path([1.5, 500.0, 3.5])], {0: path([1.5, before, 3.5])}, "minimal")
    MinimalRecord(before=60, kept=(7,), topics=("command",), one_minimal=True).save(one.folder)
    rated(one, 4, 4)
    relevance(one.run(), one.folder).save(one.folder)
    record = rules(one.run(), one.folder, budget=80, validation=20)
    record.save(one.folder)
    return one, record


def test_any_element(tmp_path: Path) -> None:
    one, record = learnt(tmp_path, lambda xs: any(x > 100 for x in xs))
    assert record.text == "any(command:poses[*].x) > 100"
    assert record.types["command:max(poses[*].x)"] == "float64"
    assert record.checks == 20
    assert record.balanced_accuracy == 1
    assert record.stl_signals == {"command_max_poses_x": "command:max(poses[*].x)"}
    assert (one.folder / "sanitize.hpp").exists()
    log = [path([1, 2]), path([1, 2, 3, 101], 1), path([], 2)]
    found = predict(Rule.from_json(record.rule), record.topics, log, registry=TypeRegistry())
    assert (found.judged, found.fails, found.moments[0].place) == (3, 1, 1)
    assert RuleGuard(one.folder / "rule.json").topics == ["command"]


def test_one_element(tmp_path: Path) -> None:
    _, record = learnt(tmp_path, lambda xs: len(xs) > 1 and xs[1] > 100)
    assert record.text == "command:poses[1].x > 100"


@pytest.mark.parametrize("elements", [[7.0], ["a", 500.0], [0.5] * 2000])
def test_what_is_no_small_array_of_numbers_stays_as_it_is(tmp_path: Path, elements: list[Any]) -> None:
    from riot_bus.chain.unit.arrays import with_arrays
    from riot_bus.chain.unit.questions import UnitQuestions
    from riot_bus.generalize.sampling import Variable

    one = bench(tmp_path)
    payload = json.dumps({"r": elements}).encode()
    write_finding(one, [Message(10**18, "command", payload)], {}, "minimal")
    questions = UnitQuestions(one.run(), one.folder)
    field = questions.fields.fields[f"command:r[{min(len(elements), 2) - 1}]"]
    variable = Variable(field.name, field.leaf.type, field.leaf.value)
    assert with_arrays(questions, [field], [variable]) == [variable]
