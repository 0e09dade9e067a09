from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.testing.exploration import explore
from tests.unit.chain.machine import Bench, bench, never_hangs


def where(one: Bench) -> tuple[Path, Path]:
    return one.workspace.context.file.path, one.workspace.out


def explored(one: Bench, **options: object) -> None:
    explore(*where(one), trials=30, runners=one.machine, **options)


def test_what_it_finds_is_the_failure_with_the_minimal_log_the_rule_and_the_line_that_reproduces_it(
    tmp_path: Path,
) -> None:
    one = bench(tmp_path)
    with pytest.raises(AssertionError) as failure:
        explored(one)
    text = str(failure.value)
    assert text.startswith("1 finding in ")
    assert "-> 1 needed" in text
    assert "rule      precision" in text
    assert "again     riot reproduce " in text


def test_what_was_explored_costs_nothing_again(tmp_path: Path) -> None:
    with pytest.raises(AssertionError) as first:
        explored(bench(tmp_path))
    again = bench(tmp_path)
    with pytest.raises(AssertionError) as second:
        explored(again)
    assert again.machine.executed == []
    told = [[line for line in str(each.value).splitlines() if "effort" not in line] for each in (first, second)]
    assert told[0] == told[1]


def test_a_larger_budget_goes_on(tmp_path: Path) -> None:
    few = explore(
        *where(bench(tmp_path, fails=never_hangs)), trials=5, runners=bench(tmp_path, fails=never_hangs).machine
    )
    one = bench(tmp_path, fails=never_hangs)
    more = explore(*where(one), trials=20, runners=one.machine)
    assert more.tested > few.tested
    assert one.machine.executed != []


def test_only_the_steps_that_are_asked_for_are_carried_out(tmp_path: Path) -> None:
    with pytest.raises(AssertionError) as failure:
        explored(bench(tmp_path), steps=["minimize"])
    assert "-> 1 needed" in str(failure.value)
    assert "rule" not in str(failure.value)


def test_a_unit_that_passes_passes(tmp_path: Path) -> None:
    explored(bench(tmp_path, fails=never_hangs))
