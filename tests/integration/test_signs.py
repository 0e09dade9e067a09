"""Units that misbehave are found and named rightly, robust ones are not found: real processes on a real bus."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.campaign.confirm import repeat, repeat_in_order
from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.pool.local import Pool
from riot_bus.processes.activity import Idle
from riot_bus.trial.baseline import Baseline, probe_of
from riot_bus.trial.evidence import has_debugger
from riot_bus.trial.unit_trial import UnitTrial
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict
from tests.systems.misbehaviour.catalogue import FAULTY, ORDER, ROBUST, build, missing, write
from tests.tiers import chosen, scaled

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

TRIALS = scaled(60, gate=16)
CAMPAIGNS = 2
GATE = (
    *("deadlock", "lost_worker", "faults_in_c", "silent"),
    *("muted_by_mode", "timers", "homes"),
)
"""One of most signs; `benchmarks/verdicts.py` runs many campaigns of all."""


@pytest.mark.parametrize("seed", range(scaled(CAMPAIGNS)))
@pytest.mark.parametrize("kind", chosen(FAULTY, gate=FAULTY.keys() & GATE))
def test_a_fault_is_found_and_named(tmp_path: Path, kind: str, seed: int) -> None:
    if missing(kind):
        pytest.skip(f"NOT TESTED: native faults: there is no {missing(kind)}")
    build(tmp_path, kind)
    wanted = FAULTY[kind]
    wanted = (wanted,) if isinstance(wanted, str) else wanted
    with Workspace(write(tmp_path), tmp_path / "out", jobs=2, seed=seed) as workspace:
        trials = TRIALS * (4 if kind == "sometimes" or len(wanted) > 1 else 1)
        folders = run_campaign(workspace, kind, trials=trials, seconds=None, covered=False)
        records = [FindingRecord.load(folder) for folder in folders]
    assert sorted(record.signature for record in records) == [each.format(kind) for each in wanted]
    for folder, record in zip(folders, records, strict=True):
        assert record.rate is not None
        assert record.rate.count == record.rate.total or kind == "sometimes"
        assert record.nominal is not None
        assert record.nominal.count == 0
        evidence = {path.name: path for path in (folder / "evidence").iterdir()}
        assert {"trial.json", "outputs.mcap", f"{kind}.resources.csv"} <= evidence.keys()
        if record.monitor == "crash" and kind != "exit_status":
            told = evidence[f"{kind}.{'stdout' if kind == 'stdout_traceback' else 'stderr'}.txt"].read_text()
            assert "misbehave" in told
        if record.monitor == "hang":
            assert record.signature.rpartition(" ")[2] in evidence[f"{kind}.stacks.txt"].read_text()
        if "SIGSEGV" in record.signature and has_debugger():
            assert ("row" if kind == "faults_in_c" else "place_" if kind == "twenty_faults" else "memset") in evidence[
                "backtrace.txt"
            ].read_text()
    assert not CampaignRecord.load(tmp_path / "out").notes


@pytest.mark.parametrize("seed", range(scaled(CAMPAIGNS)))
@pytest.mark.parametrize("kind", chosen(ROBUST, gate=set(ROBUST) & set(GATE)))
def test_a_robust_unit_has_no_finding(tmp_path: Path, kind: str, seed: int) -> None:
    with Workspace(write(tmp_path), tmp_path / "out", jobs=2, seed=seed) as workspace:
        assert run_campaign(workspace, kind, trials=TRIALS, seconds=None, covered=False) == []
    record = CampaignRecord.load(tmp_path / "out")
    assert (record.unconfirmed, record.notes) == ((), {})


def between_modes(x: float, *, mode: int) -> tuple[Message, ...]:
    """Commands, each between a mode of 1 and one of 0, and a bad one in the middle while the mode is as given."""
    found = []
    for number in range(30):
        said = [("mode", {"m": 1}), ("cmd", {"x": 1.0}), ("mode", {"m": 0})]
        if number == 15:
            said.insert(1 if mode else 3, ("cmd", {"x": x}))
        found += [(key, json.dumps(value).encode()) for key, value in said]
    return tuple(
        Message(10**18 + number * 10**7, key, payload, encoding="application/json")
        for number, (key, payload) in enumerate(found)
    )


def test_a_failure_that_depends_on_the_order_of_two_topics_is_confirmed_in_order(tmp_path: Path) -> None:
    signature = f'crash in {ORDER}: handle: raise ValueError("bad while the mode is 1")'
    with Workspace(write(tmp_path), tmp_path / "out", jobs=2) as workspace:
        runner = workspace.runners.unit(ORDER, lambda: workspace.unit_log(ORDER))
        _, rate = repeat_in_order(TestCase(between_modes(1e9, mode=1)), signature, runner)
        assert rate.rate == 1.0
        kept = replace(TestCase(between_modes(1e9, mode=0)), ordered=True)
        assert repeat(kept, signature, runner).hits == 0


@pytest.mark.parametrize("kind", ["raises", "sys_exit"])
def test_what_has_failed_for_certain_is_not_waited_for(tmp_path: Path, kind: str) -> None:
    """Its process goes on, and each answer that timers might still bring took two seconds, twice in a trial."""
    path = write(tmp_path)
    with Workspace(path, tmp_path / "out") as workspace, Pool(path, 1, keep=tmp_path / "trials") as pool:
        log = workspace.unit_log(kind)
        usual = Baseline(
            Idle(50.0, 0.01),
            trials=3,
            log=log,
            probe=probe_of(log),
            log_answers={"state": 30},
            probe_answers={"state": 14},
            main_ends=False,
            ends=False,
        )
        bad = Injection("cmd", "x", 1e9, first=5, last=5)
        outcome = pool.execute(UnitTrial(kind, usual), TestCase(log, (bad,)))
    assert {each.signature for each in outcome.violations} == {str(FAULTY[kind]).format(kind)}
    assert outcome.seconds < 4.0


@pytest.mark.parametrize("unprobed", [True, False])
def test_a_probe_that_makes_a_unit_fail_can_be_left_out(tmp_path: Path, unprobed: bool) -> None:
    path = write(tmp_path)
    with Workspace(path, tmp_path / "out") as workspace, Pool(path, 1, keep=tmp_path / "trials") as pool:
        log = workspace.unit_log("raises")
        bad = (log[-1].with_(payload=b'{"x": 1e9}'),)
        usual = Baseline(trials=3, log=log, probe=bad, probe_answers={"state": 1}, main_ends=False, ends=False)
        trial = UnitTrial("raises", usual)
        outcomes = pool.map(trial, [TestCase(messages, unprobed=unprobed) for messages in (log, (*log, *bad))])
    assert [outcome.verdict is Verdict.FAIL for outcome in outcomes] == [not unprobed, True]


def test_a_unit_that_is_busy_taking_memory_does_not_hang(tmp_path: Path) -> None:
    """It takes longer to have too much than a unit may be busy, as on a loaded machine."""
    system = write(tmp_path, ["takes_all_memory"])
    system.write_text(system.read_text().replace("timeout = 2.0", "timeout = 0.1").replace('cpu = "1.5 s"', "cpu = 0"))
    with Workspace(system, tmp_path / "out", jobs=1) as workspace:
        log = workspace.unit_log("takes_all_memory")
        runner = workspace.runners.unit("takes_all_memory", lambda: log)
        (outcome,) = runner.run([TestCase(log, (Injection("cmd", "x", 1e9, first=5, last=5),))])
    assert [each.signature for each in outcome.violations] == ["limit of takes_all_memory: memory"]


def riot_test(system: Path, cwd: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "riot_bus", "test", "--system", str(system), *options]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


@pytest.mark.nightly
def test_the_output_folder_may_be_named_from_elsewhere(tmp_path: Path) -> None:
    """What components tell of themselves does not depend on their working folder."""
    system, here = write(tmp_path), tmp_path / "here"
    here.mkdir()
    done = riot_test(system, here, "--unit=sys_exit", "--trials=16", "--out=out")
    assert done.returncode == 1, done.stderr
    (folder,) = done.stdout.splitlines()
    assert FindingRecord.load(here / folder).signature == str(FAULTY["sys_exit"]).format("sys_exit")


MUTE = """
class Mute:
    topics = ("state",)

    def judge(self, view):
        return []

    def forge(self, view):
        return view
"""


def test_monitors_that_cannot_judge_are_told_and_nothing_is_called_passed(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "mute.py").write_text(MUTE)
    with path.open("a") as stream:
        stream.write('[[monitors]]\nkind = "finite"\nfield = "sate:y"\n[[monitors]]\nkind = "mute.py"\n')
        stream.write('[[monitors]]\nkind = "finite"\nfield = "state:y"\n')
    done = riot_test(path, tmp_path, "--unit=refuses", "--trials=2")
    assert done.returncode == 5, done.stderr
    assert done.stdout.splitlines() == [
        "inconclusive: Finite sate:y: no message of 'sate' came; did you mean 'state'?",
        "inconclusive: Mute state: it is silent on a trial that is to violate it",
    ]


KILLS = """
import json, os

class Kills:
    topics = ("state",)

    def judge(self, view):
        if view.inputs and not any(json.loads(each.payload).get("x") == 0.0 for each in view.inputs):
            os.kill(os.getpid(), 9)
        return []
"""


def test_a_case_that_kills_its_worker_is_told_and_not_passed_and_the_campaign_goes_on(tmp_path: Path) -> None:
    """An injected trial of this seed is without the first command."""
    path = write(tmp_path)
    (tmp_path / "kills.py").write_text(KILLS)
    text = path.read_text().replace("[unit.echoes]\n", "[unit.echoes]\nmined = false\n")
    path.write_text(text + '[[monitors]]\nkind = "kills.py"\n')
    for deaths in (3, 0):
        done = riot_test(path, tmp_path, "--unit=echoes", "--trials=3", "--seed=2")
        assert done.returncode == 5, done.stderr
        assert done.stdout.startswith("inconclusive: 1 test case could not be judged: 3 processes that executed it")
        assert done.stderr.count("the process of a trial has ended with signal 9") == deaths
        record = CampaignRecord.load(tmp_path / "riot-out")
        assert (record.tested, record.failing, record.findings) == (6, 0, ())
        assert [(each["fault"], each["first"]) for each in record.unjudged[0].injections] == [("drop", 0)]
