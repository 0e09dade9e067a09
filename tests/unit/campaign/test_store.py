from __future__ import annotations

import math
import resource
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import pytest

from riot_bus.campaign.store import _CREATE, StoredRunner, TrialStore, stored_trials
from riot_bus.vocabulary.errors import EnvironmentFaultError, OutOfTimeError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation
from riot_bus.zenoh.session import wait_until

FAILED = Outcome(
    Verdict.FAIL,
    (Violation("crash", "u", "one"), Violation("hang", "u", "two \udc80")),
    0.5,
    "why \udc80",
    {},
    None,
    {"x": math.inf},
)


class Answers:
    """A runner that gives one answer after the other, several trials at once."""

    parallelism = 5

    def __init__(self, *verdicts: Verdict) -> None:
        self.left = list(verdicts)

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        return [Outcome(self.left.pop(0)) for _ in cases]


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"verdict": "perhaps"}', "1"])
def test_what_is_no_outcome_is_asked_again(tmp_path: Path, text: str) -> None:
    path = tmp_path / TrialStore.NAME
    case = TestCase(seed=1)
    StoredRunner(Answers(Verdict.PASS), TrialStore(path), scope={}).run([case])
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("UPDATE trials SET outcome = ?", (text,))
    store = TrialStore(path)
    assert len(store) == 1
    (row,) = stored_trials(path)
    assert store.get(str(row["key"])) is None
    again = StoredRunner(Answers(Verdict.FAIL), store, scope={})
    assert again.run([case])[0].verdict is Verdict.FAIL
    assert again.executed == 1
    kept = TrialStore(path).get(str(row["key"]))
    assert kept is not None
    assert kept.verdict is Verdict.FAIL


def test_rows_tell_what_others_want_to_know(tmp_path: Path) -> None:
    store = TrialStore(tmp_path / TrialStore.NAME)
    store.put("b", FAILED)
    store.put("a", Outcome(Verdict.PASS))
    first, second = stored_trials(store.path)
    assert first == {
        "number": 1,
        "key": "b",
        "verdict": "fail",
        "signatures": f"{FAILED.violations[0].signature}\n{FAILED.violations[1].signature}".replace(
            "\udc80", "\\udc80"
        ),
        "seconds": 0.5,
        "detail": "why \\udc80",
    }
    assert (second["key"], second["verdict"]) == ("a", "pass")
    assert store.get("b") == FAILED


WRITER = """
import sys
from pathlib import Path
from riot_bus.campaign.store import TrialStore
from riot_bus.vocabulary.trial import Outcome, Verdict
store = TrialStore(Path(sys.argv[1]))
for number in range(10**9):
    store.put(str(number), Outcome(Verdict.PASS))
    print(number, flush=True)
"""


def test_a_killed_writer_loses_nothing_that_it_has_put(tmp_path: Path) -> None:
    path = tmp_path / TrialStore.NAME
    for _ in range(3):
        with subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            assert wait_until(lambda: len(stored_trials(path)) > 50, 60)  # while it is written
            line = writer.stdout.readline()
            writer.kill()
            last = int((writer.stdout.read().split() or [line])[-1])
        store = TrialStore(path)
        assert len(store) >= last + 1
        assert all(store.get(str(number)) == Outcome(Verdict.PASS) for number in range(last + 1))
        store.close()


FILLER = """
import sys
from pathlib import Path
from riot_bus.campaign.store import TrialStore
from riot_bus.vocabulary.trial import Outcome, Verdict
store = TrialStore(Path(sys.argv[1]))
number = 0
try:
    for number in range(10**9):
        store.put(str(number), Outcome(Verdict.PASS, detail="x" * 1000))
except OSError as error:
    print(error.errno, number, len(store))
"""


def test_a_full_disk_is_told_and_takes_no_half_of_an_outcome(tmp_path: Path) -> None:
    path = tmp_path / TrialStore.NAME
    limit = 1 << 18
    done = subprocess.run(
        [sys.executable, "-c", FILLER, path],
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    code, number, count = map(int, done.stdout.split())
    assert (code, count) == (28, number)
    assert number > 10
    store = TrialStore(path)
    assert len(store) == number
    store.put("more", FAILED)
    assert store.get("more") == FAILED


def test_what_is_no_store_is_told_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / TrialStore.NAME
    assert stored_trials(path) == []
    path.write_bytes(b"no database " * 100)
    for opened in (TrialStore, stored_trials):
        with pytest.raises(EnvironmentFaultError, match="not a database"):
            opened(path)
    assert path.read_bytes() == b"no database " * 100


def test_a_trial_that_succeeds_at_the_last_attempt_is_kept(tmp_path: Path) -> None:
    store = TrialStore(tmp_path / "deep" / TrialStore.NAME)
    runner = StoredRunner(Answers(Verdict.ERROR, Verdict.ERROR, Verdict.PASS), store, scope={})
    assert [outcome.verdict for outcome in runner.run([TestCase()])] == [Verdict.PASS]
    assert (runner.trials, runner.executed, len(store)) == (1, 3, 1)


def test_equal_cases_are_executed_once_and_each_outcome_is_told(tmp_path: Path) -> None:
    told: list[Outcome] = []
    store = TrialStore(tmp_path / TrialStore.NAME)
    runner = StoredRunner(Answers(Verdict.PASS, Verdict.FAIL), store, scope={}, told=told.append)
    outcomes = runner.run([TestCase(seed=1), TestCase(seed=2), TestCase(seed=1)])
    assert [outcome.verdict for outcome in outcomes] == [Verdict.PASS, Verdict.FAIL, Verdict.PASS]
    assert told == outcomes
    assert (runner.trials, runner.executed, runner.parallelism) == (3, 2, 5)


def said(number: int) -> Message:
    return Message(number, "topic", b"%d" % number)


def test_what_was_injected_into_a_log_is_kept_with_what_came_of_it(tmp_path: Path) -> None:
    log = (said(1), said(2))
    high = Injection("topic", "x", 5.0, first=1)
    raw = Injection("topic", "y", b"\x00")
    cases = [TestCase(log), TestCase(log, (high,), 3), TestCase((said(1),), (high,)), TestCase(log, (high, raw), 4)]
    store = TrialStore(tmp_path / TrialStore.NAME)
    scope = {"unit": "one"}
    answers = Answers(Verdict.PASS, Verdict.FAIL, Verdict.PASS, Verdict.PASS)
    StoredRunner(answers, store, scope=scope).run(cases)
    StoredRunner(Answers(Verdict.FAIL), store, scope={"unit": "one two"}).run(cases[1:2])
    found = [(len(rows), seed, outcome.verdict) for rows, seed, outcome in store.tried(scope, log)]
    assert found == [(1, 3, Verdict.FAIL), (2, 4, Verdict.PASS)]
    rows = next(store.tried(scope, log))[0]
    assert (rows[0]["topic"], rows[0]["value"], rows[0]["first"]) == ("topic", 5.0, 1)
    assert list(store.tried({"unit": "none"}, log)) == []


HANGS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT"


@pytest.mark.parametrize(
    "made",
    [
        f"CREATE VIEW trials AS {HANGS} x AS number, '' AS key, '' AS verdict, '' AS signatures, 0 AS seconds,"
        " '' AS detail, '' AS outcome, '' AS injected FROM n",
        "{create}; CREATE TRIGGER t AFTER INSERT ON trials BEGIN DELETE FROM trials; END",
        "CREATE TABLE trials (number INTEGER PRIMARY KEY, key TEXT, injected AS (hex(zeroblob(1000000000))))",
    ],
    ids=["view", "trigger", "computed"],
)
def test_a_store_with_anything_but_our_table_is_not_asked(tmp_path: Path, made: str) -> None:
    """SQLite carries out what a schema says: a view of a stranger's store may never end."""
    path = tmp_path / TrialStore.NAME
    with closing(sqlite3.connect(path)) as other, other:
        other.executescript(made.format(create=_CREATE))
    for opened in (TrialStore, stored_trials):
        with pytest.raises(EnvironmentFaultError, match="something else, has made it"):
            opened(path)


def test_a_case_that_cannot_be_judged_is_kept_for_who_takes_it_and_an_error_for_others(tmp_path: Path) -> None:
    store = TrialStore(tmp_path / TrialStore.NAME)
    strict = StoredRunner(Answers(Verdict.UNJUDGED, Verdict.PASS), store, scope={})
    with pytest.raises(EnvironmentFaultError, match="could not be carried out"):
        strict.run([TestCase()])
    assert (strict.executed, len(store)) == (1, 0)
    for executed in (1, 0):
        runner = StoredRunner(Answers(Verdict.UNJUDGED), store, scope={}, unjudged=True)
        assert [outcome.verdict for outcome in runner.run([TestCase()])] == [Verdict.UNJUDGED]
        assert (runner.executed, len(store)) == (executed, 1)
    assert [outcome.verdict for outcome in strict.run([TestCase()])] == [Verdict.PASS]


def test_trials_of_others_are_forgotten_and_their_room_is_given_back(tmp_path: Path) -> None:
    path = tmp_path / TrialStore.NAME
    store = TrialStore(path)
    for system in ("old", "new"):
        cases = [TestCase(seed=number) for number in range(200)]
        answers = Answers(*[Verdict.PASS] * len(cases))
        StoredRunner(answers, store, scope={"system": system, "unit": "u"}).run(cases)
    size = path.stat().st_size + path.with_name(f"{path.name}-wal").stat().st_size
    assert store.keep_only('"system": "new"') == 200
    assert len(store) == 200
    assert store.keep_only('"system": "new"') == 0
    again = StoredRunner(Answers(), store, scope={"system": "new", "unit": "u"})
    again.run(cases)
    assert again.executed == 0
    store.close()
    assert path.stat().st_size < size


def test_nothing_new_is_executed_when_the_time_is_over(tmp_path: Path) -> None:
    store, until = TrialStore(tmp_path / TrialStore.NAME), [float("inf")]
    runner = StoredRunner(Answers(Verdict.PASS), store, scope={}, until=lambda: until[0])
    case, other = TestCase(seed=1), TestCase(seed=2)
    runner.run([case])
    until[0] = 0.0
    assert runner.run([case])[0].verdict is Verdict.PASS  # it is known
    with pytest.raises(OutOfTimeError, match="the time was over"):
        runner.run([case, other])
    assert runner.executed == 1
