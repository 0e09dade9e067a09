"""What a unit does in nominal trials is measured on real processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.monitors.mined import NO_RULES
from riot_bus.pool.local import Pool
from riot_bus.pool.nominal import measure_baseline
from riot_bus.trial.baseline import Baseline
from riot_bus.vocabulary.errors import RiotError
from tests.systems.misbehaviour.catalogue import write

pytestmark = pytest.mark.integration


def baseline(tmp_path: Path, kind: str, path: Path | None = None) -> Baseline:
    with (
        Workspace(path or write(tmp_path), tmp_path / "out") as workspace,
        Pool(workspace.context.file.path, 2, keep=tmp_path / "trials") as pool,
    ):
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


def test_rules_are_mined_and_held_against_other_trials_unless_they_are_not_wanted(tmp_path: Path) -> None:
    found = baseline(tmp_path, "echoes").mined
    assert (found.trials, found.alarms, found.held_out, found.dropped) == (6, 0, 8, ())
    claimed = {str(rule) for rule in found.rules if rule.kind != "finite"}
    assert claimed == {"count of state", "counter of state:n", "clock of state:t", "value of state:y"}
    path = tmp_path / "riot.toml"
    path.write_text(path.read_text().replace("[unit.echoes]\n", "[unit.echoes]\nmined = false\n"))
    with (
        Workspace(path, tmp_path / "out") as workspace,
        Pool(workspace.context.file.path, 2, keep=tmp_path / "trials") as pool,
    ):
        log = workspace.unit_log("echoes")
        assert measure_baseline(workspace.context, "echoes", pool, log).mined == NO_RULES


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ('{ memory = "5 MiB" }', "was ended before it was ready: it had memory of"),
        ('{ memory = "200 MiB" }', "hits a limit in a nominal trial: it had memory of"),
    ],
)
def test_a_limit_that_nominal_trials_hit_is_an_error_that_says_so(tmp_path: Path, limits: str, words: str) -> None:
    path, node = write(tmp_path), tmp_path / "node.py"
    path.write_text(path.read_text().replace("[components.refuses]", f"[components.refuses]\nlimits = {limits}"))
    node.write_text(
        node.read_text().replace("    bad = is_bad", "    kept.append(b'1' * (16 << 20))\n    bad = is_bad")
    )
    with pytest.raises(RiotError, match=words) as caught:
        baseline(tmp_path, "refuses", path)
    assert "limits" in str(caught.value)


def test_what_cannot_be_judged_for_want_of_nominal_trials_is_told(tmp_path: Path) -> None:
    with (
        Workspace(write(tmp_path), tmp_path / "out") as workspace,
        Pool(workspace.context.file.path, 2, keep=tmp_path / "trials") as pool,
    ):
        log = [*workspace.unit_log("raises")]
        log.append(log[-1].with_(payload=b'{"x": 1e9}'))
        found = measure_baseline(workspace.context, "raises", pool, log)
    assert found.trials == 0
    told = "exit, silent, growth and mined: 3 of 3 trials with 35 nominal messages did not pass: crash in raises: "
    assert found.mute[0].startswith(told)


def test_answers_to_the_probe_are_waited_for_where_the_log_has_brought_some(tmp_path: Path) -> None:
    """On a loaded machine a unit seemed at rest before it had its probe; silence was no failure then."""
    path, node = write(tmp_path), tmp_path / "node.py"
    path.write_text(path.read_text().replace("[unit.echoes]\n", "[unit.echoes]\nmined = false\n"))
    late = "    if count == 30:\n        time.sleep(0.15)\n    bad = is_bad"
    node.write_text(node.read_text().replace("    bad = is_bad", late))
    assert baseline(tmp_path, "echoes", path).probe_answers.keys() == {"state"}
