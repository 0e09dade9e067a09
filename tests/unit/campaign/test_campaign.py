from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from riot_bus.campaign.campaign import run_campaign
from riot_bus.campaign.schedule import Schedule, targets_of
from riot_bus.campaign.store import StoredRunner, TrialStore
from riot_bus.campaign.targets import Target
from riot_bus.campaign.triage import finding_id
from riot_bus.inject.dictionary import Dictionary, load_dictionary
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
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
    return run_campaign(LOG, schedule(), runner, seed=0, trials=trials)


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


def test_nothing_to_inject() -> None:
    with pytest.raises(ConfigError, match="no field"):
        Schedule({}, load_dictionary(), seed=0)


def test_campaign_groups_by_signature_and_keeps_the_simplest() -> None:
    def answer(case: TestCase) -> Outcome:
        speeds = [one.value for one in case.injections if one.field == "speed"]
        if any(isinstance(value, float) and value < 0 for value in speeds):
            return Outcome(Verdict.FAIL, (CRASH,), statistics={"played": 20})
        return Outcome(Verdict.PASS)

    result = campaign(Pure(answer), trials=60)
    assert result.trials == 62
    assert result.exhausted
    (failure,) = result.failures.values()
    assert failure.occurrences == result.failing > 1
    assert failure.modified == len(failure.injections)
    assert finding_id(failure.violation) == finding_id(CRASH)


def test_unit_that_fails_nominally_is_a_finding_without_injections() -> None:
    result = campaign(Pure(lambda case: Outcome(Verdict.FAIL, (CRASH,))))
    assert result.trials == 2
    assert next(iter(result.failures.values())).injections == ()


def test_unit_that_sometimes_fails_nominally_is_inconclusive() -> None:
    answers = iter([Outcome(Verdict.PASS), Outcome(Verdict.FAIL, (CRASH,))])
    with pytest.raises(InconclusiveError):
        campaign(Pure(lambda case: next(answers)))


def test_progress_counts_trials_and_failures() -> None:
    told: list[tuple[int, int, str]] = []
    nominal = [Outcome(Verdict.PASS), Outcome(Verdict.PASS)]
    run_campaign(
        LOG,
        schedule(),
        Pure(lambda case: nominal.pop() if nominal else Outcome(Verdict.FAIL, (CRASH,))),
        seed=0,
        trials=6,
        progress=lambda *words: told.append(words),
    )
    assert [done for done, _, _ in told] == [4, 6]
    assert {total for _, total, _ in told} == {6}
    assert told[-1][2] == "6 failing, 1 distinct"


def test_a_field_without_exceptional_values_is_never_drawn() -> None:
    targets = {"cmd": [Target("cmd", "speed", "float64", 20), Target("cmd", "mode", "string", 20)]}
    dictionary = Dictionary()
    dictionary.add('type = "float64"\n[[entry]]\nvalue = nan\nreason = "r"', where="mine.toml")
    only = Schedule(targets, dictionary, seed=0)
    assert {one.field for trial in range(30) for one in only.injections(trial)} == {"speed"}


def test_store_resumes_and_survives_a_cut_line(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    observed = {"x": Series((0.5,), (math.nan,)), "y": Series((0.5,), (math.inf,))}
    pure = Pure(lambda case: Outcome(Verdict.FAIL, (CRASH,), observed=observed, statistics={"played": 3}))
    cases = [TestCase(LOG, seed=seed) for seed in range(3)]
    first = StoredRunner(pure, TrialStore(path), scope={"unit": "part"}).run(cases)
    with path.open("a") as stream:
        stream.write('{"key": "half')
    store = TrialStore(path)
    assert store.unreadable == 1
    again = StoredRunner(pure, store, scope={"unit": "part"})
    assert repr(again.run(cases)) == repr(first)
    assert (again.executed, len(pure.executed)) == (0, 3)
    assert again.run([TestCase(LOG, seed=9)])[0].violations == (CRASH,)
    assert len(TrialStore(path)) == 4
    assert StoredRunner(pure, store, scope={"unit": "other"}).run(cases[:1]) != []
    assert len(pure.executed) == 5


def test_errors_are_tried_again_and_never_kept(tmp_path: Path) -> None:
    answers = iter([Outcome(Verdict.ERROR, detail="no port"), Outcome(Verdict.PASS)])
    store = TrialStore(tmp_path / "trials.jsonl")
    assert StoredRunner(Pure(lambda case: next(answers)), store, scope={}).run([TestCase()])[0].verdict is Verdict.PASS
    broken = Pure(lambda case: Outcome(Verdict.ERROR, detail="no port"))
    with pytest.raises(EnvironmentFaultError, match="no port"):
        StoredRunner(broken, store, scope={}).run([TestCase(seed=1)])
    assert len(broken.executed) == 3
    assert len(store) == 1
