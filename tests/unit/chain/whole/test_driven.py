from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.chain.base.external import external_fields
from riot_bus.chain.whole.driven import DrivenRuns, Usual, as_numbers, internal_of, strongest
from riot_bus.findings.permeability import Design, EdgeRecord
from riot_bus.system.system_file import RunPace
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Series, Verdict
from tests.unit.chain.machine import HANG, MODE, SPEED, SYSTEM, Bench, bench, commands, said


def outcome(**values: tuple[object, ...]) -> Outcome:
    observed = {name: Series(tuple(map(float, range(len(some)))), some) for name, some in values.items()}  # type: ignore[arg-type]
    return Outcome(Verdict.PASS, observed=observed)


def told(*outcomes: Outcome) -> list[dict[str, tuple[object, ...]]]:
    numbers = as_numbers(outcomes, ["x"])
    return [{name.replace(chr(0), " is "): series.values for name, series in one.items()} for one in numbers]


def test_numbers_are_told_as_they_are() -> None:
    assert told(outcome(x=(1.0, 2, True)), outcome(x=())) == [{"x": (1.0, 2, True)}, {"x": ()}]


def test_of_texts_it_is_told_whether_a_field_has_each_of_them() -> None:
    found = told(outcome(x=("a", "b", "a")), outcome(x=("c",)))
    assert found == [
        {"x is a": (1.0, 0.0, 1.0), "x is b": (0.0, 1.0, 0.0), "x is c": (0.0, 0.0, 0.0)},
        {"x is a": (0.0,), "x is b": (0.0,), "x is c": (1.0,)},
    ]
    assert {internal_of(name) for name in as_numbers([outcome(x=("a", "b", "c"))], ["x"])[0]} == {"x"}


def test_of_two_texts_one_tells_of_both_and_one_alone_tells_nothing() -> None:
    assert told(outcome(x=("a", "b", "a"))) == [{"x is a": (1.0, 0.0, 1.0)}]
    assert told(outcome(x=("a", "a"))) == [{}]


def test_texts_beyond_the_most_frequent_ones_are_not_told_apart() -> None:
    (found,) = told(outcome(x=(*(f"text {number}" for number in range(40)), "text 7")))
    assert len(found) == 8
    assert "x is text 7" in found


def test_of_several_edges_of_a_pair_the_one_that_shows_most_is_kept() -> None:
    def edge(strength: float, *, permeable: bool) -> EdgeRecord:
        return EdgeRecord(
            external="e", internal="i", permeable=permeable, strength=strength, low=0, high=1, lag_s=0, p_value=0
        )

    weak, strong, none = edge(0.1, permeable=True), edge(0.4, permeable=True), edge(0.9, permeable=False)
    assert strongest([weak, none, strong]) == {("e", "i"): strong}


def driven(folder: Path) -> tuple[Bench, DrivenRuns]:
    one = bench(folder)
    runner = one.machine.system(RunPace(duration=3), observe=(SPEED, MODE, "panel"))
    return one, DrivenRuns(one.run(), runner, (), (SPEED, MODE), {SPEED: Usual(20.0, 60.0, moves=True)})


def test_each_field_has_its_own_signal_in_each_run(tmp_path: Path) -> None:
    one, system = driven(tmp_path)
    found = system.within(external_fields(one.workspace), range(3))
    signals = [signal for plan, _ in found for signal in plan.values()]
    assert len(signals) == len({signal.seed for signal in signals}) == 9
    assert {signal.hold for signal in signals} == {5}
    assert all(run.inputs.keys() == {"panel:knob", "panel:lever", "panel:heat"} for run in system.runs(found))


def test_a_parameter_that_its_node_refuses_has_not_been_driven(tmp_path: Path) -> None:
    gain = "[external.parameters]\ngain = { nominal = 1, range = [0, 9] }\n[external.ranges]"
    one = bench(tmp_path, SYSTEM.replace("[external.ranges]", gain))
    runner = one.machine.system(RunPace(duration=3), observe=(SPEED,))
    system = DrivenRuns(one.run(), runner, (), (SPEED,), {})
    (field,) = (each for each in external_fields(one.workspace) if each.parameter)
    taken, refused = outcome(), replace(outcome(), statistics={"refused": {"gain": "/n refused 3: no"}})
    assert system.why_undriven(field, [taken] * 3 + [refused], least=3) == ""
    assert "its node refused nearly all values" in system.why_undriven(field, [taken] * 2 + [refused], least=3)


def fresh_only(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that refuses readings whose heat is the one of before."""
    heats = [said(each)["heat"] for each in readings]
    return commands([each for place, each in enumerate(readings) if not place or heats[place] != heats[place - 1]])


def test_fields_that_too_few_runs_tell_apart_are_not_said_to_freeze_anything(tmp_path: Path) -> None:
    one = bench(tmp_path, governor=fresh_only)
    runner = one.machine.system(RunPace(duration=3), observe=(SPEED, "panel"))
    system = DrivenRuns(one.run(), runner, (), (SPEED,), {SPEED: Usual(20.0, 60.0, moves=True)})
    fields = external_fields(one.workspace)
    (heat,) = (field for field in fields if field.path == "heat")
    assert system.freezing(fields, range(2)) == ([], fields, 2)
    found, unsettled, spent = system.freezing(fields, range(24))
    assert (found, unsettled) == ([heat], [])
    assert spent <= 8


def test_a_run_that_has_failed_has_not_frozen(tmp_path: Path) -> None:
    _, system = driven(tmp_path)
    silent = outcome(**{SPEED: (3.0, 3.1), MODE: ()})
    assert system.freezes(silent)
    assert not system.freezes(replace(silent, verdict=Verdict.FAIL, violations=(HANG,)))


@pytest.mark.parametrize(
    ("design", "internal", "external"),
    [("between runs", SPEED, "panel:knob"), ("beyond nominal", MODE, "panel:lever")],
)
def test_fields_are_constant_in_a_run(tmp_path: Path, design: Design, internal: str, external: str) -> None:
    one, system = driven(tmp_path)
    fields = external_fields(one.workspace)
    edges, spent, untold, _ = system.between(fields, range(24), alpha=0.01, design=design)
    assert untold == {}
    assert spent in (24, 48)
    assert len({case.seed for case in one.machine.executed}) == spent
    assert {(edge.external, edge.internal) for edge in edges if edge.permeable and edge.internal == internal} == {
        (external, internal)
    }
    assert {edge.design for edge in edges} == {design}
    injections = [injection for case in one.machine.executed for injection in case.injections]
    assert not any(isinstance(injection.value, Signal) for injection in injections)
    knobs = [injection.value for injection in injections if injection.field == "knob"]
    beyond = [value for value in knobs if isinstance(value, float) and not 20 <= value <= 100]
    assert bool(beyond) == (design == "beyond nominal")
