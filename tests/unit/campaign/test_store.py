from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from riot_bus.campaign.store import StoredRunner, TrialStore
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict


class Answers:
    """A runner that gives one answer after the other, several trials at once."""

    parallelism = 5

    def __init__(self, *verdicts: Verdict) -> None:
        self.left = list(verdicts)

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        return [Outcome(self.left.pop(0)) for _ in cases]


def test_a_line_that_is_no_outcome_is_asked_again(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    case = TestCase(seed=1)
    StoredRunner(Answers(Verdict.PASS), TrialStore(path), scope={}).run([case])
    record = json.loads(path.read_text())
    record["outcome"]["verdict"] = "perhaps"
    path.write_text(json.dumps(record) + "\n")
    store = TrialStore(path)
    assert len(store) == 1
    assert store.get(record["key"]) is None
    again = StoredRunner(Answers(Verdict.FAIL), store, scope={})
    assert again.run([case])[0].verdict is Verdict.FAIL
    assert again.executed == 1
    kept = TrialStore(path).get(record["key"])
    assert kept is not None
    assert kept.verdict is Verdict.FAIL


def test_a_trial_that_succeeds_at_the_last_attempt_is_kept(tmp_path: Path) -> None:
    store = TrialStore(tmp_path / "deep" / "trials.jsonl")
    runner = StoredRunner(Answers(Verdict.ERROR, Verdict.ERROR, Verdict.PASS), store, scope={})
    assert [outcome.verdict for outcome in runner.run([TestCase()])] == [Verdict.PASS]
    assert (runner.trials, runner.executed, len(store)) == (1, 3, 1)


def test_equal_cases_are_executed_once_and_each_outcome_is_told(tmp_path: Path) -> None:
    told: list[Outcome] = []
    store = TrialStore(tmp_path / "trials.jsonl")
    runner = StoredRunner(Answers(Verdict.PASS, Verdict.FAIL), store, scope={}, told=told.append)
    outcomes = runner.run([TestCase(seed=1), TestCase(seed=2), TestCase(seed=1)])
    assert [outcome.verdict for outcome in outcomes] == [Verdict.PASS, Verdict.FAIL, Verdict.PASS]
    assert told == outcomes
    assert (runner.trials, runner.executed, runner.parallelism) == (3, 2, 5)
