"""What a unit does in nominal trials is measured on real processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.workspace import Workspace
from riot_bus.sut.baseline import Baseline
from riot_bus.sut.local import Pool
from riot_bus.sut.nominal import measure_baseline
from tests.systems.misbehaviour.catalogue import write

pytestmark = pytest.mark.integration


def baseline(tmp_path: Path, kind: str) -> Baseline:
    with Workspace(write(tmp_path), tmp_path / "out") as workspace, Pool(2, keep=tmp_path / "trials") as pool:
        return measure_baseline(workspace.context, kind, pool, workspace.unit_log(kind))


def test_outputs_and_threads_of_a_unit(tmp_path: Path) -> None:
    found = baseline(tmp_path, "lost_worker")
    assert found.trials == 3
    assert found.log_answers == {"state": 30}
    assert found.probe_answers.keys() == {"state"}
    assert found.threads == {"worker": 1, "<module>": 1}
    assert (found.main_ends, found.ends) == (False, False)


def test_a_timer_is_told_from_silence(tmp_path: Path) -> None:
    found = baseline(tmp_path, "timers")
    assert found.probe_answers.keys() == {"state", "tick"}
    assert found.idle.switches > 20


def test_of_a_unit_without_outputs_its_threads_are_known(tmp_path: Path) -> None:
    found = baseline(tmp_path, "silent_by_design")
    assert (found.probe_answers, found.log_answers) == ({}, {})
    assert found.at_rest == {"main": 1}
