"""A unit alone runs its own command, the whole system the component's; with real processes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import UnitTrial
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import TestCase, Verdict
from tests.systems.misbehaviour.catalogue import write

pytestmark = [pytest.mark.integration, pytest.mark.timeout(240)]

BAD = Injection("cmd", "x", 1e9, first=3, last=3)
OWN = """[unit.echoes]
command = ["{python}", "../node.py", "raises", "{endpoint}"]
cwd = "debug"
"""


def test_the_units_own_command_runs_alone_and_the_components_in_the_system(tmp_path: Path) -> None:
    path = write(tmp_path, ["echoes"])
    (tmp_path / "debug").mkdir()
    path.write_text(path.read_text().replace("[unit.echoes]\n", OWN))
    with Workspace(path, tmp_path / "out", jobs=1) as workspace:
        log = workspace.unit_log("echoes")
        case = TestCase(log, (BAD,))
        with Pool(path, 1, keep=tmp_path / "trials") as pool:
            for number in range(2):  # the second time both are forked, from servers of their own
                alone = pool.execute(UnitTrial("echoes"), case)
                whole = pool.execute(SystemTrial(RunPace(duration=5.0)), case)
                assert alone.violations[0].signature == 'crash in echoes: misbehave: raise ValueError("bad")'
                assert alone.statistics["started"] == ("forked" if number else "executed")
                assert whole.verdict is Verdict.PASS, whole
            pool.execute(UnitTrial("echoes", evidence=True), case, into=tmp_path / "evidence")
    told = json.loads((tmp_path / "evidence/trial.json").read_text())
    assert told["commands"] == {"echoes": ["{python}", "../node.py", "raises", "{endpoint}"]}
