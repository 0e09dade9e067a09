from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.campaign.campaign import CampaignSettings, run_campaign
from riot_bus.campaign.covering import Covering
from riot_bus.campaign.schedule import Schedule, message_faults, positions_of
from riot_bus.campaign.store import StoredRunner, TrialStore
from riot_bus.campaign.targets import Target, targets_of
from riot_bus.campaign.triage import finding_id
from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import Dictionary, load_dictionary
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Series, TestCase, Verdict, Violation

LOG = tuple(
    Message(10**9 + n, "cmd", json.dumps({"seq": n, "speed": 1.5, "mode": "auto", "header": {"stamp": n}}).encode())
    for n in range(20)
)
CRASH = Violation("crash", "part", "crash in part: a.py:1 in f", "ValueError: 1")


class Pure:
    """A runner that is a function."""

    parallelism = 2

    def __init__(self, answer: Callable[[TestCase], Outcome]) -> None:
        self.answer = answer
        self.executed: list[TestCase] = []

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        self.executed += cases
        return [self.answer(case) for case in cases]


def schedule(seed: int = 0) -> Schedule:
    return Schedule(targets_of(LOG, TypeRegistry()), load_dictionary(), seed=seed)


def campaign(runner: Pure, trials: int = 30):
    return run_campaign(LOG, schedule(), runner, CampaignSettings(seed=0, trials=trials))


def test_brittle_fields_are_left_alone_unless_asked_for() -> None:
    paths = {target.path for target in targets_of(LOG, TypeRegistry())["cmd"]}
    assert paths == {"speed", "mode"}
    assert "seq" in {target.path for target in targets_of(LOG, TypeRegistry(), include=["cmd:seq"])["cmd"]}
    assert {target.path for target in targets_of(LOG, TypeRegistry(), leave=["cmd:mo*"])["cmd"]} == {"speed"}


def test_schedule_depends_on_seed_and_trial_alone() -> None:
    drawn = [schedule().injections(trial) for trial in range(20)]
    for trial in reversed(range(20)):
        assert repr(schedule().injections(trial)) == repr(drawn[trial])
    assert repr([schedule(1).injections(trial) for trial in range(20)]) != repr(drawn)
    for injection in (one for policy in drawn for one in policy):
        assert injection.last is not None
        assert 0 <= injection.first <= injection.last < len(LOG)


def test_values_are_tried_all_over_an_array_and_then_in_its_other_elements() -> None:
    log = [Message(10**9 + n, "scan", b'{"ranges": [%s]}' % b", ".join([b"1.5"] * 40)) for n in range(50)]
    registry = TypeRegistry()
    items = Schedule(targets_of(log, registry), load_dictionary(), seed=0).items()
    covering = Covering(items, positions_of(log, registry), seed=0)
    first = [str(item.injections[0].field) for item in items]
    assert len(set(first)) > 10
    seen = set()
    for _ in range(100):
        group = covering.next() or covering.further()
        seen |= {str(placed.item.injections[0].field) for placed in group}
        covering.record(group, Outcome(Verdict.PASS))
    assert seen >= {f"ranges[{number}]" for number in range(40)} > set(first)


@pytest.mark.parametrize("monitor", ["hang", "crash"])
def test_hangs_take_no_more_than_half_of_the_time_once_they_are_known(monitor: str) -> None:
    registry = TypeRegistry()
    found = Violation(monitor, "part", f"{monitor} of part")

    def answer(case: TestCase) -> Outcome:
        bad = any(each.field == "speed" and each.value != 1.5 for each in case.injections)
        return Outcome(Verdict.FAIL if bad else Verdict.PASS, (found,) if bad else (), seconds=10.0 if bad else 1.0)

    covering = Covering(schedule().items(), positions_of(LOG, registry), seed=0)
    result = run_campaign(LOG, schedule(), Pure(answer), CampaignSettings(seed=0, trials=300), covering=covering)
    assert list(result.failures) == [found.signature]
    assert result.failing >= 8
    share = 10.0 * result.failing / (9.0 * result.failing + result.trials)
    if monitor == "hang":
        assert share < 0.6
        assert result.calm > 100
    else:
        assert share > 0.6
        assert result.calm == 0


def test_nothing_to_inject() -> None:
    with pytest.raises(ConfigError, match="no field"):
        Schedule({}, load_dictionary(), seed=0)


def injected(case: TestCase) -> bool:
    speeds = [one.value for one in case.injections if one.field == "speed"]
    return any(isinstance(value, float) and value < 0 for value in speeds)


def failing(case: TestCase, *others: Violation) -> Outcome:
    return Outcome(Verdict.FAIL, (CRASH, *others), statistics={"played": 20, "modified": len(case.injections)})


def test_campaign_groups_by_signature_and_keeps_the_simplest() -> None:
    pure = Pure(lambda case: failing(case) if injected(case) else Outcome(Verdict.PASS))
    result = campaign(pure, trials=60)
    assert (result.trials, result.exhausted) == (64, True)
    (failure,) = result.failures.values()
    assert failure.occurrences == result.failing > 1
    simplest = min(len(case.injections) for case in pure.executed if injected(case))
    assert failure.modified == len(failure.case.injections) == simplest
    assert finding_id(failure.violation) == finding_id(CRASH)
    assert failure.rate is not None
    assert (failure.rate.hits, failure.rate.total) == (4, 4)
    assert failure.nominal is not None
    assert (failure.nominal.hits, failure.nominal.total) == (0, 4)


CUT, NAN, BAD = Injection("cmd", fault="truncate"), Injection("cmd", "speed", math.nan), Injection("cmd", "speed", -1.0)
TEXT = Injection("cmd", "speed", "1")


@pytest.mark.parametrize(
    ("together", "kept"),
    [
        ([(CUT, NAN, BAD)], (BAD,)),
        ([(CUT, NAN)], (CUT, NAN)),  # the cut payload alone does it
        ([(TEXT,), (CUT, BAD)], (BAD,)),  # text in place of a number is strange, and the number among others is not
    ],
)
def test_plain_values_stand_for_a_failure_where_they_do_the_same_alone(
    together: Sequence[tuple[Injection, ...]], kept: tuple[Injection, ...]
) -> None:
    class Together(Schedule):
        def injections(self, trial: int) -> tuple[Injection, ...]:
            return together[trial]

    def answer(case: TestCase) -> Outcome:
        return failing(case) if injected(case) or {CUT, TEXT} & set(case.injections) else Outcome(Verdict.PASS)

    fields = targets_of(LOG, TypeRegistry())
    schedule = Together(fields, load_dictionary(), seed=0)
    result = run_campaign(LOG, schedule, Pure(answer), CampaignSettings(seed=0, trials=len(together)))
    (failure,) = result.failures.values()
    assert failure.case.injections == kept
    assert failure.modified == len(kept)


@pytest.mark.parametrize("signature", ["exit of part: a thread has ended: run", "exit of part: status 0"])
def test_what_is_only_told_by_comparing_is_no_failure_where_nominal_trials_show_it(signature: str) -> None:
    ended = Violation("exit", "part", signature)
    fails = iter(range(10**6))

    def answer(case: TestCase) -> Outcome:
        found = (CRASH,) if injected(case) else ()
        found += (ended,) if next(fails) % 2 else ()
        return Outcome(Verdict.FAIL if found else Verdict.PASS, found, statistics={"played": 20})

    result = campaign(Pure(answer), trials=60)
    compared = "a thread" in signature
    assert set(result.failures) == ({CRASH.signature} if compared else {CRASH.signature, signature})
    assert list(result.alarms) == ([signature] if compared else [])
    assert (f"{signature}: nominal trials show the same" in result.notes) == compared


@pytest.mark.parametrize("every", [True, False])
def test_growth_with_each_message_is_no_failure_of_trials_that_have_more_of_them(*, every: bool) -> None:
    """A unit grows with each message, or with each of a burst: only the latter depends on what is injected."""
    grows = Violation("growth", "part", "growth of part: memory")

    def answer(case: TestCase) -> Outcome:
        count = len(inject_log(case.messages, case.injections, registry=TypeRegistry(), seed=case.seed)[0])
        fails = count > 60 and (every or case.injections)
        return Outcome(Verdict.FAIL if fails else Verdict.PASS, (grows,) if fails else (), statistics={"played": count})

    pure = Pure(answer)
    faults = message_faults(LOG, TypeRegistry())
    covering = Covering(faults, positions_of(LOG, TypeRegistry()), seed=0)
    result = run_campaign(LOG, schedule(), pure, CampaignSettings(seed=0, trials=120), covering=covering)
    assert set(result.failures) == (set() if every else {grows.signature})
    assert (result.failing == 0) == every
    assert list(result.alarms) == ([grows.signature] if every else [])
    most = max(len(case.messages) for case in pure.executed if not case.injections)
    assert most > 2 * 60
    assert sum(len(case.messages) > len(LOG) for case in pure.executed) <= 12


def test_all_violations_of_a_trial_count() -> None:
    other = Violation("range", "out:x", "range of out:x", "7")
    result = campaign(Pure(lambda case: failing(case, other) if injected(case) else Outcome(Verdict.PASS)), trials=60)
    assert {each.violation for each in result.failures.values()} == {CRASH, other}


def test_a_failure_that_does_not_come_again_is_no_finding() -> None:
    seen = set()

    def once(case: TestCase) -> Outcome:
        if not injected(case) or case.again or len(seen) > 1:
            return Outcome(Verdict.PASS)
        seen.add(case.digest())
        return failing(case)

    found: list[object] = []
    result = run_campaign(LOG, schedule(), Pure(once), CampaignSettings(seed=0, trials=60), found=found.append)
    assert (result.failing, dict(result.failures), found) == (len(seen), {}, [])
    (failure,) = result.unconfirmed.values()
    assert failure.rate is not None
    assert (failure.rate.hits, failure.rate.total) == (0, 20)


def test_a_failure_that_comes_at_times_is_a_finding_with_its_rate() -> None:
    def at_times(case: TestCase) -> Outcome:
        chance = int(case.digest(), 16) % 10 < 3
        return failing(case) if injected(case) and chance else Outcome(Verdict.PASS)

    result = campaign(Pure(at_times), trials=200)
    (failure,) = result.failures.values()
    assert failure.rate is not None
    assert failure.rate.low < 0.3 < failure.rate.high


def test_findings_are_told_when_they_are_confirmed() -> None:
    told: list[tuple[int, str]] = []
    pure = Pure(lambda case: failing(case) if injected(case) else Outcome(Verdict.PASS))
    run_campaign(
        LOG,
        schedule(),
        pure,
        CampaignSettings(seed=0, trials=60),
        found=lambda failure: told.append((len(pure.executed), failure.violation.signature)),
    )
    assert len(told) == 1
    assert told[0][0] < len(pure.executed)


def test_unit_that_fails_nominally_is_a_finding_without_injections() -> None:
    result = campaign(Pure(lambda case: Outcome(Verdict.FAIL, (CRASH,))))
    assert (result.trials, result.exhausted) == (4, False)
    (failure,) = result.failures.values()
    assert failure.case.injections == ()
    assert failure.nominal is not None
    assert failure.nominal.rate == 1.0


def test_a_unit_that_sometimes_fails_nominally_is_tested_all_the_same() -> None:
    def flaky(case: TestCase) -> Outcome:
        return Outcome(Verdict.FAIL, (CRASH,)) if int(case.digest(), 16) % 10 < 4 else Outcome(Verdict.PASS)

    result = campaign(Pure(flaky), trials=10)
    assert result.exhausted
    (failure,) = result.failures.values()
    assert failure.case.injections == ()
    assert failure.nominal is not None
    assert failure.nominal.total == 16
    assert failure.nominal.low < 0.4 < failure.nominal.high


def test_what_monitors_say_of_themselves_is_kept() -> None:
    result = campaign(Pure(lambda case: Outcome(Verdict.PASS, detail="Range: KeyError: 'x'")), trials=4)
    assert result.notes == {"Range: KeyError: 'x'": 8}


def test_a_monitor_that_saw_nothing_in_any_trial_is_told() -> None:
    lines = iter([["Range a:x: no message", "Rate b: no message"]] * 7 + [["Range a:x: none of 1 messages"]])
    result = campaign(Pure(lambda case: Outcome(Verdict.PASS, statistics={"unseen": next(lines)})), trials=4)
    assert result.notes == {"Range a:x: none of 1 messages": 8}


def test_monitors_that_are_blind_by_turns_are_not_blind() -> None:
    lines = iter([["Range a:x: no message"], ["Range a:x (2): no message"]] * 4)
    result = campaign(Pure(lambda case: Outcome(Verdict.PASS, statistics={"unseen": next(lines)})), trials=4)
    assert result.notes == {}


def test_of_what_never_came_nominally_nothing_is_missed() -> None:
    """The topic of the monitor may be misspelt."""
    missed = Violation("sometimes", "out", "never reached: out", "")
    there = Outcome(Verdict.FAIL, (missed,), statistics={"baseless": {missed.signature: "no message of 'out' came"}})

    def answer(case: TestCase) -> Outcome:
        return replace(there, violations=(CRASH, missed)) if injected(case) else there

    result = campaign(Pure(answer), trials=60)
    assert set(result.failures) == {CRASH.signature}
    assert result.notes == {"never reached: out: no message of 'out' came, in no nominal trial": 4}
    once = iter([there, *[replace(there, statistics={})] * 100])  # it came in the other trials, and was not enough
    assert set(campaign(Pure(lambda case: next(once)), trials=4).failures) == {missed.signature}


def test_trials_that_did_not_keep_the_order_are_counted() -> None:
    given_up = Outcome(Verdict.PASS, statistics={"unordered": True})
    result = campaign(Pure(lambda case: given_up if case.injections else Outcome(Verdict.PASS)), trials=8)
    assert result.unordered == 8


def test_a_failure_whose_repeats_cannot_be_judged_is_told() -> None:
    def answer(case: TestCase) -> Outcome:
        if case.again:
            return Outcome(Verdict.UNJUDGED, detail="its worker was killed")
        return failing(case) if injected(case) else Outcome(Verdict.PASS)

    result = campaign(Pure(answer), trials=60)
    assert result.failures == {}
    assert f"{CRASH.signature}: none of its repeats could be judged" in result.notes


def test_progress_counts_trials_and_failures() -> None:
    told: list[tuple[int, int | None, str, float | None]] = []
    run_campaign(
        LOG,
        schedule(),
        Pure(lambda case: Outcome(Verdict.FAIL, (CRASH,)) if case.injections else Outcome(Verdict.PASS)),
        CampaignSettings(seed=0, trials=20),
        progress=lambda *words: told.append(words),
    )
    rounds = [words for words in told if not words[2].endswith(", repeating a failure")]
    assert [done for done, *_ in rounds] == [8, 16, 20]
    assert {(total, left) for _, total, _, left in told} == {(20, None)}
    assert rounds[-1][2] == "20 failing, 1 distinct"


def test_progress_is_told_while_failures_are_repeated_and_of_the_time_that_is_left() -> None:
    told: list[tuple[int, int | None, str, float | None]] = []
    covering = Covering(schedule().items(), positions_of(LOG, TypeRegistry()), seed=0)
    run_campaign(
        LOG,
        schedule(),
        Pure(lambda case: failing(case) if injected(case) else Outcome(Verdict.PASS)),
        CampaignSettings(seed=0, trials=10_000, covered=True, seconds=600.0),
        covering=covering,
        progress=lambda *words: told.append(words),
    )
    assert any(words[2].endswith(" tried, repeating a failure") for words in told)
    assert {total for _, total, _, _ in told} == {None}  # all is tried before 10,000 trials
    left = [each for *_, each in told if each is not None]
    assert len(left) == len(told)
    assert left == sorted(left, reverse=True)
    assert 0 < left[-1] <= left[0] <= 600


def test_each_thing_is_tried_before_others_are_drawn_again() -> None:
    pure, plan = Pure(lambda case: failing(case) if injected(case) else Outcome(Verdict.PASS)), schedule()
    items = plan.items()
    covering = Covering(items, positions_of(LOG, TypeRegistry()), seed=0)
    result = run_campaign(LOG, plan, pure, CampaignSettings(seed=0, trials=200), covering=covering)
    assert len(result.tried) == result.coverable == len(items) > 50
    tried = {(one.field, repr(one.value)) for case in pure.executed for one in case.injections}
    assert {(one.field, repr(one.value)) for item in items for one in item.injections} <= tried
    (failure,) = result.failures.values()
    assert len(failure.case.injections) == 1  # what has been found out alone stands for it


def test_a_campaign_may_end_when_all_was_tried() -> None:
    pure, plan = Pure(lambda case: failing(case) if injected(case) else Outcome(Verdict.PASS)), schedule()
    covering = Covering(plan.items(), positions_of(LOG, TypeRegistry()), seed=0)
    result = run_campaign(LOG, plan, pure, CampaignSettings(seed=0, trials=10_000, covered=True), covering=covering)
    assert result.exhausted
    assert len(result.tried) == result.coverable
    assert result.trials < 200
    few = Covering(plan.items(), positions_of(LOG, TypeRegistry()), seed=0)
    assert run_campaign(LOG, plan, pure, CampaignSettings(seed=0, trials=8, covered=True), covering=few).trials == 12


def test_faults_of_whole_messages_leave_alone_what_is_left_alone() -> None:
    faults = message_faults(LOG, TypeRegistry())
    assert {each.injections[0].fault for each in faults} == {"drop", "duplicate", "delay"}
    assert message_faults(LOG, TypeRegistry(), leave=["cmd:*"]) == []
    assert message_faults(LOG, TypeRegistry(), leave=["cmd:speed"]) == faults


def test_a_field_without_exceptional_values_is_never_drawn() -> None:
    targets = {"cmd": [Target("cmd", "speed", "float64", 20), Target("cmd", "mode", "string", 20)]}
    dictionary = Dictionary()
    dictionary.add('type = "float64"\n[[entry]]\nvalue = nan\nreason = "r"', where="mine.toml")
    only = Schedule(targets, dictionary, seed=0)
    assert {one.field for trial in range(30) for one in only.injections(trial)} == {"speed"}


def test_store_resumes(tmp_path: Path) -> None:
    path = tmp_path / TrialStore.NAME
    observed = {"x": Series((0.5,), (math.nan,)), "y": Series((0.5,), (math.inf,))}
    pure = Pure(lambda case: Outcome(Verdict.FAIL, (CRASH,), observed=observed, statistics={"played": 3}))
    cases = [TestCase(LOG, seed=seed) for seed in range(3)]
    first = StoredRunner(pure, TrialStore(path), scope={"unit": "part"}).run(cases)
    store = TrialStore(path)
    again = StoredRunner(pure, store, scope={"unit": "part"})
    assert repr(again.run(cases)) == repr(first)
    assert (again.executed, len(pure.executed)) == (0, 3)
    assert again.run([TestCase(LOG, seed=9)])[0].violations == (CRASH,)
    assert len(TrialStore(path)) == 4
    assert StoredRunner(pure, store, scope={"unit": "other"}).run(cases[:1]) != []
    assert len(pure.executed) == 5


def test_errors_are_tried_again_and_never_kept(tmp_path: Path) -> None:
    answers = iter([Outcome(Verdict.ERROR, detail="no port"), Outcome(Verdict.PASS)])
    store = TrialStore(tmp_path / TrialStore.NAME)
    assert StoredRunner(Pure(lambda case: next(answers)), store, scope={}).run([TestCase()])[0].verdict is Verdict.PASS
    broken = Pure(lambda case: Outcome(Verdict.ERROR, detail="no port"))
    with pytest.raises(EnvironmentFaultError, match="no port"):
        StoredRunner(broken, store, scope={}).run([TestCase(seed=1)])
    assert len(broken.executed) == 3
    assert len(store) == 1


UNJUDGED = Outcome(Verdict.UNJUDGED, detail="3 processes have ended")


def test_a_case_that_cannot_be_judged_is_told_and_the_campaign_goes_on() -> None:
    cases = iter(range(100))

    def some(case: TestCase) -> Outcome:
        blind = Outcome(Verdict.PASS, statistics={"unseen": ["Range a:x: none of 1 messages"]})
        return UNJUDGED if case.injections and next(cases) in (3, 8) else blind

    result = campaign(Pure(some), trials=12)
    assert [(bool(case.injections), why) for case, why in result.unjudged] == [(True, "3 processes have ended")] * 2
    assert (result.trials, result.failing, result.exhausted) == (16, 0, True)
    assert (result.failures, result.unconfirmed) == ({}, {})
    assert result.notes == {"Range a:x: none of 1 messages": 14}  # what nobody has judged tells nothing of it


def test_a_nominal_log_that_cannot_be_judged_is_an_error() -> None:
    with pytest.raises(EnvironmentFaultError, match="nominal log could not be carried out: 3 processes have ended"):
        campaign(Pure(lambda case: Outcome(Verdict.PASS) if case.injections or case.seed else UNJUDGED))


def test_a_stop_in_a_batch_loses_no_finished_trial(tmp_path: Path) -> None:
    class Stopped(Pure):
        def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]:
            for number in (2, 0):
                ended(number, self.run([cases[number]])[0])
            raise KeyboardInterrupt

    cases = [TestCase(LOG, seed=seed) for seed in range(4)]
    store = TrialStore(tmp_path / TrialStore.NAME)
    with pytest.raises(KeyboardInterrupt):
        StoredRunner(Stopped(lambda case: Outcome(Verdict.PASS)), store, scope={}).run(cases)
    pure = Pure(lambda case: Outcome(Verdict.PASS))
    assert len(StoredRunner(pure, TrialStore(store.path), scope={}).run(cases)) == 4
    assert [case.seed for case in pure.executed] == [1, 3]
