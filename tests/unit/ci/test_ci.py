"""What `riot ci` says of versions of a machine, one after the other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.campaign.store import TrialStore, stored_trials
from riot_bus.chain.base.workspace import Workspace
from riot_bus.ci.ci import CiPlan, CiResult, UnitResult, run_ci, unit_folder, units_of
from riot_bus.events import FindingReplayed, StepStopped
from riot_bus.findings.known import KnownFindings
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.report.campaign_view import CampaignView
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.reports import HOSTILE_TEXT
from tests.report_samples import campaign_with_baseline
from tests.unit.chain.machine import HANG, OTHER, SYSTEM, Machine, always, hangs, never_hangs
from tests.unit.chain.repository import CHANGE, Repository


def test_a_finding_that_nobody_knows_fails_the_build_and_ends_the_test(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    result = repository.change()
    (unit,) = result.units
    assert repository.standings(unit) == {HANG.signature: "new"}
    assert result.exit_code(strict=False) == 1
    record = CampaignRecord.load(repository.drive)
    assert record.stopped == "a new finding is enough"
    assert record.tested < 44
    (folder,) = (one.directory for one in result.failures)
    assert folder == repository.drive / "findings" / folder.name
    assert f"    riot reproduce {folder}" in unit.lines()
    assert result.lines()[-1] == "1 finding that the baseline does not know"


def test_a_known_one_does_not_and_all_of_it_is_tested(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(*(one.directory for one in repository.change().failures), note="ticket 12")
    repository.commit()
    result = repository.change()
    (unit,) = result.units
    assert repository.standings(unit) == {HANG.signature: "known"}
    assert result.exit_code(strict=True) == 0
    record = CampaignRecord.load(repository.drive)
    assert (record.stopped, record.tested) == ("", 44)
    assert any(line.startswith("  known: hang of drive (") and line.endswith(" (ticket 12)") for line in unit.lines())
    assert result.lines()[-1] == "no new finding"


def test_a_known_one_is_told_though_the_campaign_has_not_seen_it(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    (folder,) = (one.directory for one in repository.change().failures)
    length = FindingRecord.load(folder).messages
    repository.accept(folder, keep=tmp_path / "kept")
    repository.commit(lambda messages: hangs(messages) if len(messages) == length else None)
    unit = repository.one()
    assert repository.standings(unit) == {HANG.signature: "known"}
    (replayed,) = (event for event in repository.events if isinstance(event, FindingReplayed))
    assert (replayed.answer, replayed.failed, replayed.trials, replayed.text) == ("still failing", 3, 3, "")
    assert (
        unit.view.verdict == "no finding in 44 trials of drive; 1 more known finding of the same code, found otherwise"
    )


def test_a_fix_is_told_and_nothing_else_is_claimed(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(*(one.directory for one in repository.change().failures))
    repository.commit(never_hangs)
    result = repository.change()
    (unit,) = result.units
    assert (repository.standings(unit), result.exit_code(strict=True)) == ({}, 0)
    (remark,) = unit.view.remarks
    assert remark.startswith("fixed (known): hang of drive: 0 of 3 fresh trials failed so")
    assert "riot ci prune --update" in remark
    (folder,) = (one.directory for one in unit.view.earlier)
    assert FindingRecord.load(folder).fixed_in == unit.view.fingerprint


def test_what_was_fixed_and_comes_back_is_new_and_no_campaign_is_needed(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    (folder,) = (one.directory for one in repository.change().failures)
    repository.accept(folder, keep=tmp_path / "kept")
    repository.mark_fixed()
    repository.commit(never_hangs)
    assert repository.change().exit_code(strict=True) == 0
    assert repository.one().view.remarks == (), "that it is still fixed is no news"
    repository.commit()
    for path in (repository.drive / "findings").iterdir():
        path.rename(tmp_path / f"lost-{path.name}")  # what is kept beside the baseline is enough
    result = repository.change()
    (unit,) = result.units
    assert (repository.standings(unit), result.exit_code(strict=False)) == ({HANG.signature: "came back"}, 1)
    assert CampaignRecord.load(repository.drive).stopped.startswith(
        "the log of an earlier finding fails: hang of drive"
    )
    assert CampaignRecord.load(repository.drive).tested == 4
    (failure,) = result.failures
    assert failure.finding.fingerprint == unit.view.fingerprint
    assert any("came back: hang of drive (3 of 3 fresh trials), was fixed 2026-03-02" in line for line in unit.lines())


def test_what_an_earlier_run_has_found_stays_new_as_long_as_it_fails(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.change()
    repository.commit()
    (unit,) = repository.change(replace(CHANGE, trials=1)).units
    assert repository.standings(unit) == {HANG.signature: "new"}
    repository.commit(never_hangs)
    assert [line.partition(":")[0] for line in repository.one().view.remarks] == ["fixed (found earlier)"]
    assert repository.one().view.remarks == (), "it is told once"
    repository.commit()
    assert repository.standings(repository.one()) == {HANG.signature: "new"}


def test_a_log_that_fails_otherwise_is_a_finding_of_its_own(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(*(one.directory for one in repository.change().failures))
    repository.commit(other=lambda case: True)
    result = repository.change()
    (unit,) = result.units
    assert (repository.standings(unit), result.exit_code(strict=False)) == ({OTHER.signature: "new"}, 1)
    (remark,) = unit.view.remarks
    assert remark.startswith(
        "failing otherwise (known): hang of drive: 0 of 3 fresh trials failed so, fails as crash in"
    )
    (failure,) = result.failures
    assert (failure.finding.component, failure.finding.monitor) == ("drive", "crash")
    assert failure.finding.details == (OTHER.detail,)
    assert failure.finding.severity == "abort"


def test_what_is_not_decided_is_told_and_fails_only_where_it_is_strict(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.change()
    repository.commit(
        never_hangs, wrong=lambda case: not case.injections and len(case.messages) < 60 and case.seed == 0
    )
    result = repository.change()
    (unit,) = result.units
    assert [line.partition(":")[0] for line in unit.view.remarks] == ["not decided (found earlier)"]
    assert unit.undecided
    assert (result.exit_code(strict=False), result.exit_code(strict=True)) == (0, 5)
    assert result.warnings()[0].startswith("inconclusive: drive: hang of drive (found earlier): ")


@pytest.mark.parametrize("when", ["open", "trial"])
def test_surroundings_that_fail_are_told_and_no_failure(when: str, tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    if when == "open":
        repository.fault = "no port"
    else:
        repository.commit(broken=lambda case: bool(case.messages))
    result = repository.change()
    (unit,) = result.units
    assert (result.exit_code(strict=False), result.exit_code(strict=True)) == (0, 4)
    assert unit.view.verdict.startswith("not tested: ")
    assert "no port" in unit.untested
    assert result.warnings() == [f"not tested: drive: {unit.untested}"]
    assert result.lines()[-1] == "no new finding; 1 of 1 unit not tested"
    assert json.loads(json.dumps(unit.to_json()))["untested"] == unit.untested


def test_findings_of_before_do_not_hide_that_nothing_was_tested(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.change()
    repository.commit(broken=lambda case: True)
    result = repository.change()
    (unit,) = result.units
    assert unit.view.current == ()
    assert unit.view.campaign is None, "the campaign in the folder is that of other code"
    assert result.exit_code(strict=False) == 0


def test_mistakes_of_people_end_it(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    text = (tmp_path / "riot.toml").read_text()
    (tmp_path / "riot.toml").write_text(text.replace("[unit.drive]", "[unit.drive]\nlog = 'none.mcap'"))
    with pytest.raises(ConfigError):
        repository.change()


def test_a_unit_that_always_fails_is_a_finding(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.commit(always)
    assert repository.change().exit_code(strict=False) == 1


def test_a_long_test_goes_on_and_explains(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    unit = repository.one(CiPlan(60.0, stop_early=False, explain=True, trials=40))
    assert CampaignRecord.load(repository.drive).tested == 44
    (one,) = unit.view.current
    assert one.minimal is not None
    assert one.rule is not None
    assert (one.permeability, one.activation) == (None, None)


def test_time_that_is_over_is_told(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.change()
    repository.commit()
    ticks = iter(range(0, 10_000_000, 1_000_000))
    unit = run_ci(
        ["drive"], repository.opened, out=repository.out, known=repository.known,
        plan=CiPlan(1.0, stop_early=False, explain=True, trials=40), now=lambda: float(next(ticks)),
    ).units[0]  # fmt: skip
    assert CampaignRecord.load(repository.drive).stopped == "the time was over before"
    assert [event for event in repository.events if isinstance(event, FindingReplayed)] == []
    assert unit.view.verdict == "no finding in 4 trials of drive; ended early: the time was over before"
    assert unit.undecided == (
        "there was no time to play 1 earlier finding again", "no injected trial: the time was over before"
    )  # fmt: skip


def test_a_step_that_says_nothing_ends_the_chain_of_that_finding(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.commit(never_hangs, wrong=lambda case: bool(case.injections) and not case.again % 2)
    unit = repository.one(CiPlan(60.0, stop_early=False, explain=True, trials=16))
    assert len(unit.view.current) == 1
    stopped = [event for event in repository.events if isinstance(event, StepStopped)]
    assert [event.step for event in stopped] == ["minimize"]


def test_each_unit_gets_its_share_of_what_is_left(tmp_path: Path) -> None:
    system = SYSTEM + "\n[unit.twin]\ncomponent = 'drive'\n"
    (tmp_path / "riot.toml").write_text(system)
    assert units_of(tmp_path / "riot.toml", []) == ["drive", "twin"]
    assert units_of(tmp_path / "riot.toml", ["twin"]) == ["twin"]
    with pytest.raises(ConfigError, match="no unit 'twn'"):
        units_of(tmp_path / "riot.toml", ["twn"])
    seen = []

    def opened(unit: str, folder: Path) -> Workspace:
        machine = Machine(tmp_path, fails=never_hangs)
        machine.unit = lambda name, log: Machine.unit(machine, "drive", log)  # type: ignore[method-assign]
        seen.append((unit, folder))
        return Workspace(tmp_path / "riot.toml", folder, runners=machine)

    known = KnownFindings.load(tmp_path / "riot-baseline.json")
    (tmp_path / "out/twin").mkdir(parents=True)
    (tmp_path / "out/twin/nominal.mcap").symlink_to("nothing")
    result = run_ci(["drive", "twin"], opened, out=tmp_path / "out", known=known, plan=replace(CHANGE, trials=8))
    assert seen == [("drive", tmp_path / "out" / "drive"), ("twin", tmp_path / "out" / "twin")]
    verdicts = [unit.view.verdict for unit in result.units]
    assert verdicts == ["no finding in 12 trials of drive", "no finding in 12 trials of twin"]
    assert (tmp_path / "out/twin/nominal.mcap").samefile(tmp_path / "out/drive/nominal.mcap")
    assert not (tmp_path / "out/twin/nominal.mcap").is_symlink()


@pytest.mark.parametrize("name", ["../x", "a/b", "..", ".git", "findings", "trials", "", "a\0b"])
def test_a_units_folder_is_inside_whatever_it_is_called(name: str, tmp_path: Path) -> None:
    folder = unit_folder(tmp_path, name)
    assert folder.parent == tmp_path
    assert folder.name not in ("", ".", "..", "findings", "trials")
    assert unit_folder(tmp_path, f"{name}_") != folder


def test_the_output_folder_does_not_grow_with_each_change(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(*(one.directory for one in repository.change().failures))
    sizes = []
    for _ in range(6):
        repository.commit()
        repository.change(replace(CHANGE, trials=8))
        sizes.append(len(stored_trials(repository.drive / "trials" / TrialStore.NAME)))
    assert len(set(sizes)) == 1
    (aside,) = (repository.drive / "findings").glob("*/earlier")
    assert len(list(aside.iterdir())) <= 4


def test_a_kept_finding_of_a_unit_that_is_gone_is_not_decided(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    (folder,) = (one.directory for one in repository.change().failures)
    repository.accept(folder, keep=tmp_path / "kept")
    (kept,) = (tmp_path / "kept" / "findings").iterdir()
    FindingRecord.load(kept).model_copy(update={"unit": "gone"}).save(kept)
    repository.mark_fixed()
    repository.commit(never_hangs)
    result = repository.change()
    assert result.units[0].undecided == ("hang of drive (was fixed 2026-03-02): riot.toml has no unit 'gone'",)
    assert result.exit_code(strict=False) == 0


def test_exit_codes() -> None:
    def unit(**more: object) -> UnitResult:
        return UnitResult("u", CampaignView(Path("o"), None, (), known={}), **more)  # type: ignore[arg-type]

    assert CiResult((unit(),)).exit_code(strict=True) == 0
    assert CiResult((unit(), unit(untested="no port"))).exit_code(strict=True) == 4
    assert CiResult((unit(), unit(undecided=("x",)))).exit_code(strict=True) == 5
    assert CiResult((unit(), unit(untested="x", undecided=("x",)))).exit_code(strict=False) == 0


def test_all_is_said_for_people_in_lines_that_move_no_cursor(tmp_path: Path) -> None:
    view = campaign_with_baseline("several", tmp_path, note=HOSTILE_TEXT)
    lines = CiResult((UnitResult("planner", view),)).lines()
    assert lines[0] == f"planner: {view.verdict}"
    assert any(line.startswith("  known: IndexError in costmap.py:update") for line in lines)
    assert lines[-1] == "no new finding"
    assert all(line.isprintable() for line in lines)


def test_programs_get_each_finding_with_its_standing(tmp_path: Path) -> None:
    view = campaign_with_baseline("several", tmp_path)
    told = json.loads(json.dumps(UnitResult("planner", view, ("x",)).to_json()))
    assert [each["standing"] for each in told["findings"]] == [view.standing(one) for one in view.current]
    assert told["doubts"][0] == "x"
    assert told["remarks"] == ["ticket 12"]
