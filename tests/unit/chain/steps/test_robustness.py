from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from riot_bus.campaign.store import TrialStore, stored_trials
from riot_bus.chain.base.external import system_log
from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.steps import robustness
from riot_bus.chain.steps.reproduce import reproduce
from riot_bus.events import CampaignFinished, FindingWritten, StepFinished, StepProgress, TrialFinished
from riot_bus.findings.records import CampaignRecord, FindingRecord, MinimalRecord
from riot_bus.findings.steps import MINIMIZE
from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import LogReader, read_log
from riot_bus.trial.baseline import Baseline
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation
from tests.unit.chain.machine import (
    COUNT,
    HANG,
    LOGGED,
    OTHER,
    SYSTEM,
    Bench,
    PureRunner,
    always,
    bench,
    hangs,
    never_hangs,
    rated,
    said,
    share,
    write_finding,
    write_nominal,
)


def campaign(one: Bench, **options: Any) -> list[Path]:
    return robustness.test_unit(one.workspace, "drive", **{"trials": 30, "seconds": None, "covered": False, **options})


def test_failures_become_findings_with_the_log_as_it_was_delivered(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (folder,) = campaign(one)
    record = FindingRecord.load(folder)
    assert (record.id, record.signature, record.unit, record.component) == (
        folder.name,
        HANG.signature,
        "drive",
        "drive",
    )
    assert record.details == (HANG.detail,)
    log = FailingLog.load(folder / "failure.mcap", registry=one.workspace.context.registry)
    assert hangs(log.messages) == len(log.messages) - 1 == record.messages - 1  # it ends where the unit hung
    assert len(log.originals) == record.modified > 0
    assert hangs(list(log.originals.values())) is None
    with LogReader(folder / "failure.mcap") as reader:
        assert {entry.sequence for entry in reader.provenance()} == set(log.originals)
    assert (folder / "reproduce.sh").is_file()


def test_how_the_unit_was_started_is_told(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=never_hangs)
    play, why = one.machine.play, "executed, since its imports start 2 threads"
    ways = iter(["executed"])

    def started(case: TestCase) -> Outcome:
        outcome = play(case)
        return replace(outcome, statistics={**outcome.statistics, "started": next(ways, why)})

    one.machine.play = started  # type: ignore[method-assign]
    assert campaign(one) == []
    line = one.told(StepFinished)[-1].text.splitlines()[-1]
    assert line == f"how the unit was started: executed in 1 trial; {why} in 33 trials"
    assert CampaignRecord.load(one.workspace.out).started == why


def test_what_happens_is_told(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (folder,) = campaign(one)
    found = FindingRecord.load(folder)
    trials = one.told(TrialFinished)
    failing = [event for event in trials if event.verdict == "fail"]
    repeats = (
        len(trials) - 34
    )  # four are nominal; a failure is repeated, and the simplest case of it if that came later
    assert repeats in (4, 8)
    assert {(event.signature, event.detail) for event in failing} == {(HANG.signature, HANG.detail)}
    assert one.told(StepProgress)[-1].done == 30
    (written,) = one.told(FindingWritten)
    assert (written.folder, written.id, written.signature) == (str(folder), found.id, HANG.signature)
    assert written.occurrences <= found.occurrences == len(failing) - repeats
    finished = one.told(StepFinished)[-1]
    assert (finished.step, finished.trials) == ("test", len(trials))
    assert finished.text.startswith(
        f"34 trials of drive with {COUNT} messages each: {found.occurrences} failed, 1 distinct finding; "
    )
    record = CampaignRecord.load(one.workspace.out)
    assert f"; {record.covered} of {record.coverable} values and message faults tried" in finished.text
    assert record.covered <= record.coverable
    (ended,) = one.told(CampaignFinished)
    assert (ended.unit, ended.trials, ended.failing, ended.exhausted) == ("drive", 34, found.occurrences, True)
    assert ended.findings == (str(folder),)


def test_the_trial_counts_what_it_injects_and_the_simplest_failure_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    monkeypatch.setattr(robustness, "inject_log", lambda *a, **k: calls.append(a) or inject_log(*a, **k))
    one = bench(tmp_path)
    one.workspace.seed = 2  # with which fewest messages are modified by plain values, which go before others
    (folder,) = campaign(one)
    assert len(calls) <= 2  # to save it, and once more if a simpler case came later
    store = one.workspace.store
    failed = [store.get(str(row["key"])) for row in stored_trials(store.path) if row["verdict"] == "fail"]
    modified = [outcome.statistics["modified"] for outcome in failed if outcome]
    assert FindingRecord.load(folder).modified == min(modified)


def test_a_finding_that_is_there_gets_a_case_with_plain_values_though_it_has_as_many_changes(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (folder,) = campaign(one)
    plain = FindingRecord.load(folder)
    strange = Injection("command", fault="truncate", options=(("keep", 0.5),)).row()
    plain.model_copy(update={"injections": (strange,), "modified": 1}).save(folder)
    campaign(one)
    assert FindingRecord.load(folder).injections == plain.injections


def test_failures_are_told_apart_by_signature_the_frequent_first(tmp_path: Path) -> None:
    one = bench(tmp_path, other=lambda case: share(case) < 0.3)
    folders = campaign(one, trials=60)
    records = [FindingRecord.load(folder) for folder in folders]
    assert {record.signature for record in records} == {HANG.signature, OTHER.signature}
    assert records[0].occurrences >= records[1].occurrences
    assert "2 distinct findings" in one.told(StepFinished)[-1].text


def test_wrong_answers_of_a_noisy_runner_become_a_finding_with_its_low_rate(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=never_hangs, wrong=lambda case: bool(case.injections) and share(case) < 0.1)
    (folder,) = campaign(one)
    record = FindingRecord.load(folder)
    assert 1 <= record.occurrences < 10
    assert record.rate is not None
    assert record.rate.low < 0.1 < record.rate.high


@pytest.mark.parametrize(
    ("hits", "total", "asked"), [(20, 20, 1), (4, 4, 1), (10, 20, 1), (8, 20, 2), (2, 20, 6), (1, 20, 6)]
)
def test_evidence_is_tried_for_as_often_as_the_rate_of_the_finding_takes(
    tmp_path: Path, hits: int, total: int, asked: int
) -> None:
    one = bench(tmp_path)
    write_finding(one, [], {})
    rated(one, hits, total)
    tries: list[Path] = []

    def keep(unit: str, case: TestCase, signature: str, folder: Path, *, in_system: Baseline | None = None) -> bool:
        tries.append(folder)
        return len(tries) > 3

    one.machine.keep_evidence = keep  # type: ignore[method-assign]
    robustness.keep_evidence(one.workspace, FindingRecord.load(one.folder), TestCase(), one.folder)
    assert tries == [one.folder / "evidence"] * min(asked, 4)


def test_that_there_is_no_evidence_is_told_and_evidence_is_that_of_the_case(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (folder,) = campaign(one)
    told = f"what {HANG.signature} leaves: no trial that was to leave evidence failed so"
    assert told in CampaignRecord.load(one.workspace.out).untold
    cases: list[TestCase] = []

    def keep(unit: str, case: TestCase, signature: str, folder: Path, *, in_system: Baseline | None = None) -> bool:
        cases.append(case)
        folder.mkdir()
        return True

    one.machine.keep_evidence = keep  # type: ignore[method-assign]
    campaign(one)
    campaign(one)
    assert len(cases) == 1, "the case has stayed the same"
    assert told not in CampaignRecord.load(one.workspace.out).untold
    known = FindingRecord.load(folder)
    former = folder / "evidence" / "former.txt"
    former.touch()
    known.model_copy(update={"modified": known.modified + 1}).save(folder)
    campaign(one)
    assert FindingRecord.load(folder).modified == known.modified
    assert not former.exists()
    assert len(cases[-1].injections) == len(known.injections)


@pytest.mark.parametrize("seconds", [10.0, 1.0])
def test_that_values_were_kept_back_since_hangs_took_too_long_is_told(tmp_path: Path, seconds: float) -> None:
    one = bench(tmp_path)
    plain = one.machine.play

    def play(case: TestCase) -> Outcome:
        found = plain(case)
        return replace(found, seconds=seconds if found.violations else 1.0)

    one.machine.play = play  # type: ignore[method-assign]
    campaign(one, trials=200)
    record = CampaignRecord.load(one.workspace.out)
    told = [each for each in record.untold if each.startswith("whether more values hang: ")]
    if seconds > 1:
        assert record.failing >= 8
        assert len(told) == 1
        assert "since hangs took more than half of the time" in told[0]
    else:
        assert (told, 2 * record.failing < record.tested) == ([], True)


@pytest.mark.parametrize("known", [True, False])
def test_a_finding_names_what_was_injected_before_its_log_ends(tmp_path: Path, *, known: bool) -> None:
    one = bench(tmp_path)
    plain = one.machine.play

    def play(case: TestCase) -> Outcome:
        """Fail only on several injections, of which every second one is delivered."""
        several = len(case.injections) >= 4
        found = plain(case) if several else Outcome(Verdict.PASS)
        counts = {"delivered": [3 * (number % 2) for number in range(len(case.injections))]} if known else {}
        return replace(found, statistics={**found.statistics, **counts} if several else {})

    one.machine.play = play  # type: ignore[method-assign]
    (folder,) = campaign(one)
    record = FindingRecord.load(folder)
    if known:
        assert len(record.injections) >= 2
        assert record.delivered == (3,) * len(record.injections)
    else:
        assert len(record.injections) >= 4
        assert record.delivered == ()


def test_a_unit_that_always_fails_is_a_finding_without_injections(tmp_path: Path) -> None:
    (folder,) = campaign(bench(tmp_path, fails=always))
    record = FindingRecord.load(folder)
    assert (record.injections, record.modified, record.messages) == ((), 0, 1)


def test_a_failure_that_does_not_come_again_is_told_and_is_no_finding(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=never_hangs, wrong=lambda case: bool(case.injections) and not case.again)
    assert campaign(one, trials=4) == []
    (seen,) = CampaignRecord.load(one.workspace.out).unconfirmed
    assert (seen.signature, seen.repeats) == (HANG.signature, 20)
    assert "1 more did not come again in 20 fresh trials" in one.told(StepFinished)[-1].text


def test_what_was_learnt_of_a_finding_stays_when_it_is_found_again(tmp_path: Path) -> None:
    (folder,) = campaign(bench(tmp_path))
    (folder / "rule.json").write_text("{}")
    (folder / "minimal.json").write_text("{}")
    log = (folder / "failure.mcap").read_bytes()
    assert campaign(bench(tmp_path), trials=60) == [folder]
    assert (folder / "rule.json").read_text() == "{}"
    assert (folder / "failure.mcap").read_bytes() == log
    rate = FindingRecord.load(folder).rate
    again = bench(tmp_path, wrong=lambda case: share(case, 7) < 0.4)
    again.workspace.seed = 5
    assert folder in campaign(again, trials=30)
    assert FindingRecord.load(folder).rate == rate  # of the log that is kept, which was not asked again


def test_what_was_learnt_in_another_version_is_put_aside(tmp_path: Path) -> None:
    first = bench(tmp_path)
    (folder,) = campaign(first)
    (folder / "rule.json").write_text("{}")
    again = bench(tmp_path, SYSTEM + "leave = []\n\n[components.other]\ncommand = ['x']\n")
    assert again.workspace.fingerprint != first.workspace.fingerprint
    assert campaign(again) == [folder]
    assert not (folder / "rule.json").exists()
    assert (folder / "earlier" / first.workspace.fingerprint / "rule.json").read_text() == "{}"


def test_a_unit_that_never_fails_has_no_finding_and_that_is_remembered(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=never_hangs)
    assert robustness.tested(one.workspace, "drive") is None
    assert campaign(one) == []
    assert robustness.tested(one.workspace, "drive") == []
    one.workspace.seed = 7
    assert robustness.tested(one.workspace, "drive") is None


def test_a_time_budget_ends_the_campaign_after_a_batch(tmp_path: Path) -> None:
    one = bench(tmp_path)
    campaign(one, trials=10_000, seconds=1e-9)
    (ended,) = one.told(CampaignFinished)
    assert not ended.exhausted
    assert ended.trials < 20


def test_an_interrupted_campaign_goes_on_where_it_stopped(tmp_path: Path) -> None:
    one = bench(tmp_path)
    campaign(one, trials=10)
    before = len(one.machine.executed)
    again = bench(tmp_path)
    campaign(again, trials=20)
    stored = len(TrialStore(again.workspace.store.path))
    assert before + len(again.machine.executed) == stored + 1  # and the nominal run: nothing was asked twice
    assert stored >= 24


def test_trials_that_cannot_be_carried_out_end_the_campaign(tmp_path: Path) -> None:
    with pytest.raises(EnvironmentFaultError, match="no port"):
        campaign(bench(tmp_path, broken=lambda case: bool(case.messages)))


def test_dictionary_entries_that_match_nothing_are_an_error(tmp_path: Path) -> None:
    text = '[[field]]\npath = "command:sped"\nentries = [{ value = -9.0, reason = "backwards" }]\n'
    (tmp_path / "own.toml").write_text(text)
    one = bench(tmp_path, SYSTEM + 'dictionaries = ["own.toml"]\n')
    with pytest.raises(ConfigError, match=r"own.toml: field\[0\]: no field of the log is called 'command:sped'"):
        campaign(one, trials=2)
    assert not any(case.messages for case in one.machine.executed)


def test_what_only_many_messages_bring_about_is_found_replays_and_is_minimized(tmp_path: Path) -> None:
    """Eight bad speeds in a row: policies on single messages do not come to that."""

    def fails(messages: Sequence[Message]) -> int | None:
        row = 0
        for place, message in enumerate(messages):
            speed = said(message).get("speed", 0)
            row = row + 1 if isinstance(speed, float) and not abs(speed) < 1e6 else 0
            if row == 8:
                return place
        return None

    one = bench(tmp_path, SYSTEM + 'leave = ["command:mode", "command:note", "command:"]\n', fails=fails)
    (folder,) = campaign(one, trials=400)
    record = FindingRecord.load(folder)
    assert record.rate is not None
    assert record.rate.value == 1.0
    assert reproduce(one.workspace, folder, times=2).answer == "still failing"
    minimal = one.workspace.carry_out(MINIMIZE, folder)
    assert isinstance(minimal, MinimalRecord)
    assert len(minimal.kept) == 8
    assert reproduce(one.workspace, folder, times=2).answer == "still failing"


def test_nothing_on_the_inputs_of_the_unit(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM.replace('inputs = ["command"]', 'inputs = ["comand"]'))
    with pytest.raises(ConfigError, match=r"nothing on the inputs of 'drive' \(comand\)[^?]*'command'\?"):
        campaign(one)


def test_fields_that_riot_toml_leaves_alone_are_not_injected(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM + 'leave = ["command:speed"]\n')
    campaign(one, trials=10)
    injected = {each.field for case in one.machine.executed for each in case.injections}
    assert "mode" in injected
    assert "speed" not in injected


def test_what_was_learnt_of_other_versions_is_put_aside_whole_also_when_one_comes_back(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (folder,) = campaign(one)
    known = FindingRecord.load(folder)
    (folder / "evidence").mkdir()
    (folder / "evidence" / "trial.json").write_text("{}")
    for _ in range(2):
        known.model_copy(update={"fingerprint": "former"}).save(folder)
        (folder / "minimal.json").write_text("{}")
        campaign(one)
        assert not (folder / "minimal.json").exists()
    assert sorted(path.name for path in (folder / "earlier").iterdir()) == ["former", "former-2"]
    (folder / "earlier" / "former" / "finding.json").replace(folder / "finding.json")  # as if it had been cut off
    (folder / "minimal.json").write_text("{}")
    campaign(one)
    assert (folder / "earlier" / "former" / "minimal.json").exists()
    assert FindingRecord.load(folder).fingerprint == one.workspace.fingerprint


def test_cases_that_cannot_be_judged_are_told_and_neither_findings_nor_passed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    why = "3 processes that executed it have ended"

    def play(case: TestCase) -> Outcome:
        deadly = any(each.fault == "drop" for each in case.injections)
        return Outcome(Verdict.UNJUDGED, detail=why) if deadly else Outcome(Verdict.PASS)

    one.machine.unit = lambda unit, log: PureRunner(play)  # type: ignore[method-assign]
    assert campaign(one) == []
    record = CampaignRecord.load(one.workspace.out)
    (kept,) = record.unjudged
    assert (kept.detail, record.tested, record.failing) == (why, 34 - kept.occurrences, 0)
    assert {each["fault"] for each in kept.injections} >= {"drop"}
    assert record.doubts == [str(kept)]
    assert f"could not be judged: {why}" in one.told(StepFinished)[-1].text
    assert {event.verdict for event in one.told(TrialFinished)} == {"pass", "unjudged"}


def test_a_mined_rule_that_fires_no_more_often_than_by_chance_is_no_finding(tmp_path: Path) -> None:
    one = bench(tmp_path)
    rule = Violation("mined", "drive", "mined count of state")

    def play(case: TestCase) -> Outcome:
        fires = bool(case.injections) and case.again in (0, 1)
        return Outcome(Verdict.FAIL, (rule,)) if fires else Outcome(Verdict.PASS)

    one.machine.unit = lambda unit, log: PureRunner(play)  # type: ignore[method-assign]
    assert campaign(one) == []
    assert "; 1 more came again in 1 of 20 fresh trials, which may be chance" in one.told(StepFinished)[-1].text
    (kept,) = CampaignRecord.load(one.workspace.out).unconfirmed
    assert (kept.signature, kept.hits, kept.repeats) == (rule.signature, 1, 20)


def test_a_campaign_on_the_running_system_keeps_what_came_from_outside(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (folder,) = campaign(one, trials=60, whole_system=True)
    record, found = CampaignRecord.load(one.workspace.out), FindingRecord.load(folder)
    assert (found.signature, found.whole_system, found.unit) == (HANG.signature, True, "drive")
    assert folder.name.endswith("-system")
    assert one.machine.judged == ["drive"]
    log = read_log(folder / "failure.mcap")
    assert {message.key for message in log} == {"panel"}
    assert len(log) == found.messages
    assert record.whole_system
    assert "of components other than drive: whether they fall silent, hang or grow" in record.untold
    assert robustness.tested(one.workspace, "drive") is None
    with pytest.raises(InconclusiveError, match="found in runs of the whole system"):
        one.workspace.carry_out(MINIMIZE, folder)
    assert reproduce(one.workspace, folder, times=2).answer == "still failing"
    (folder / "failure.mcap").unlink()
    with pytest.raises(ConfigError, match=r"no failure\.mcap") as caught:
        reproduce(one.workspace, folder)
    assert "riot test --whole-system" in str(caught.value)


def test_what_nominal_runs_show_too_is_no_finding(tmp_path: Path) -> None:
    one = bench(tmp_path)
    one.machine.known = Baseline(trials=4, alarms=(HANG.signature,))
    assert campaign(one, whole_system=True) == []
    told = f"{HANG.signature}: nominal runs of the whole system show the same"
    assert told in CampaignRecord.load(one.workspace.out).untold


def test_what_is_planned_is_planned_on_as_much_as_a_run_has(tmp_path: Path) -> None:
    paces = "[system]\ntrial_run = { duration = 4, speed = 100 }\nnominal_run = { duration = 9, speed = 4 }"
    one = bench(tmp_path, system=SYSTEM.replace("[system]", paces))
    log = system_log(one.workspace)
    assert log[-1].time - log[0].time == 10**9, "the nominal log is four times as fast as what it tells of"


def test_what_drives_the_system_is_not_under_test(tmp_path: Path) -> None:
    aborts = Violation("crash", "panel", "crash in panel: SIGABRT", "")
    one = bench(tmp_path, system_fails=never_hangs)
    plain = one.machine.outcome

    def outcome(case: TestCase, failed: bool, **more: Any) -> Outcome:
        if case.injections and share(case) < 0.3:
            return Outcome(Verdict.FAIL, (aborts,))
        return plain(case, failed, **more)

    one.machine.outcome = outcome  # type: ignore[method-assign]
    assert campaign(one, whole_system=True) == []
    record = CampaignRecord.load(one.workspace.out)
    assert record.failing == 0
    (told,) = [each for each in record.untold if "SIGABRT" in each]
    assert told.startswith("whether the system made what drives it fail: crash in panel: SIGABRT (")


def test_a_unit_that_nominal_runs_do_not_show_is_told(tmp_path: Path) -> None:
    one = bench(tmp_path, system_fails=never_hangs)
    one.machine.known = Baseline(mute=("2 of 4 nominal runs did not pass",))
    assert campaign(one, whole_system=True) == []
    assert one.machine.judged == []
    assert (
        "whether drive still works after a run: 2 of 4 nominal runs did not pass"
        in CampaignRecord.load(one.workspace.out).untold
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('segment = "shop"', 'segment = "inside"', "share segment 'inside' with the system"),
        ('topics = ["panel"]', "topics = []", "no external topics"),
        ('topics = ["panel"]', 'topics = ["lamp"]', "holds nothing on lamp"),
    ],
)
def test_systems_of_which_nothing_can_be_intercepted_are_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        campaign(bench(tmp_path, system=SYSTEM.replace(old, new)), whole_system=True)


def test_nothing_of_a_system_can_be_changed_that_nothing_drives(tmp_path: Path) -> None:
    write_nominal(tmp_path)
    with pytest.raises(ConfigError, match="no component is external, so nothing drives the system"):
        campaign(bench(tmp_path, LOGGED), whole_system=True)


def test_a_campaign_ends_when_what_was_found_is_enough(tmp_path: Path) -> None:
    one = bench(tmp_path)
    seen: list[int] = []

    def enough(folders: Sequence[Path]) -> str:
        seen.append(len(folders))
        return "one is enough" if folders else ""

    (folder,) = campaign(one, trials=None, seconds=60.0, stop=enough)
    record = CampaignRecord.load(one.workspace.out)
    assert (record.stopped, record.findings) == ("one is enough", (folder.name,))
    assert seen[0] == 0
    assert "; ended early: one is enough" in one.told(StepFinished)[-1].text
    (ended,) = one.told(CampaignFinished)
    assert not ended.exhausted
    assert {event.total for event in one.told(StepProgress)} == {None}
    before = len(one.machine.executed)
    assert campaign(one, trials=30, stop=lambda folders: "none at all") == []
    assert CampaignRecord.load(one.workspace.out).tested == 4
    assert len(one.machine.executed) == before
