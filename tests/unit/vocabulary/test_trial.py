from __future__ import annotations

import pytest

from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation


def test_digest_follows_whatever_decides_the_outcome() -> None:
    message = Message(1, "k", b"x")
    case = TestCase((message,), (Injection("k", "f", 1),), seed=1)
    same = TestCase((message.with_(time=9, sequence=7),), (Injection("k", "f", 1),), seed=1)
    assert case.digest() == same.digest()
    others = [
        TestCase((message.with_(payload=b"y"),), case.injections, seed=1),
        TestCase((message.with_(attachment=b""),), (Injection("k", "f", 2),), seed=1),
        TestCase((message,), case.injections, seed=2),
        TestCase((message, message), case.injections, seed=1),
    ]
    assert len({case.digest(), *(other.digest() for other in others)}) == 5


def test_digests_of_stored_trials_stay_and_options_of_faults_count() -> None:
    plain = (Injection("a", "x", 1.0), Injection("a", fault="drop"))
    assert TestCase((), plain, 3).digest() == "0977dd7218231dfb36cacf327ff70941"  # campaigns of earlier versions resume
    log = (Message(1, "a", b"x", attachment=b"y"), Message(5, "b", b"", "delete", "text/plain"))
    for _ in range(2):
        assert TestCase(log, (), 3).digest() == "4221f71f972e4c33a64b2aca954beaf0"
        assert TestCase(log, (), 3, paced=True).digest() == "12befe1e01e28dcc7f442f8f969e28d5"
        assert TestCase((), plain, 3).digest() == "0977dd7218231dfb36cacf327ff70941"
    assert "options" not in plain[0].row()
    cases = [TestCase((), (Injection("a", fault="f", options=(("n", number),)),)) for number in range(3)]
    assert len({case.digest() for case in cases}) == 3


def test_the_log_of_many_cases_is_hashed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed: list[Message] = []
    digest = Message.digest
    monkeypatch.setattr(Message, "digest", lambda self: hashed.append(self) or digest(self))
    log = (Message(1, "a", b"x"), Message(2, "a", b"y"))
    cases = [TestCase(log, seed=seed) for seed in range(3)]
    digests = [case.digest() for case in cases]
    assert (len(set(digests)), len(hashed)) == (3, 2)
    copies = [TestCase(log[:1] + log[1:], seed=seed) for seed in range(3)]
    assert [case.digest() for case in copies] == digests


def test_failing_as() -> None:
    failed = Outcome(Verdict.FAIL, (Violation("crash", "a", "s"), Violation("hang", "b", "t")))
    assert failed.failed_as("t")
    assert failed.failed_as(None)
    assert not failed.failed_as("u")
    assert not Outcome(Verdict.ERROR).failed_as(None)


@pytest.mark.parametrize(
    ("monitor", "seen", "known", "same"),
    [
        ("hang", "hang of n", "hang of n: in f", True),
        ("hang", "hang of n: in f", "hang of n: in f in g", False),
        ("crash", "crash in n: SIGSEGV", "crash in n: SIGSEGV in f < g", True),
        ("crash", "crash in n: f: return x", "crash in n: f: return x in seen", False),
        ("log", "log of n: [ERROR] nav", "log of n: [ERROR] nav: lost", False),
        ("log", "log of n: no way", "log of n: no way in map", False),
    ],
)
def test_only_a_failure_whose_place_is_unknown_is_taken_for_one_with_a_place(
    monitor: str, seen: str, known: str, same: bool
) -> None:
    failed = Outcome(Verdict.FAIL, violations=(Violation(monitor, "n", seen),))
    assert failed.failed_as(known) is same
    assert failed.violation_as(known) == (failed.violations[0] if same else None)
