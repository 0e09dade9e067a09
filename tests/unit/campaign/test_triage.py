"""Failures of one signature are one finding, represented by its simplest case."""

from __future__ import annotations

from riot_bus.campaign.triage import Failure, complexity, finding_id, group, plainer, severity
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

WORN = Violation("crash", "part", "crash in part: worn", "ValueError: worn")
PLAIN, STRANGE = Injection("cmd", "x", 7), Injection("cmd", "x", float("nan"))


def failed(modified: int, *violations: Violation) -> Outcome:
    return Outcome(Verdict.FAIL, violations or (WORN,), statistics={"modified": modified})


def test_a_failure_is_represented_by_the_case_that_is_easiest_to_explain() -> None:
    failures: dict[str, Failure] = {}
    for trial, (injection, modified) in enumerate([(STRANGE, 1), (PLAIN, 9), (PLAIN, 2), (PLAIN, 5)]):
        (known,) = group(failures, TestCase(injections=(injection,)), failed(modified), trial=trial, types={})
    assert (known.trial, known.occurrences, known.details) == (2, 4, [WORN.detail])


def test_after_its_confirmation_a_simpler_case_waits() -> None:
    failures: dict[str, Failure] = {}
    (known,) = group(failures, TestCase(injections=(STRANGE,)), failed(1), trial=0, types={})
    known.rate = proportion(4, 4)
    assert known.confirmed
    group(failures, TestCase(injections=(PLAIN,)), failed(1), trial=1, types={})
    assert known.trial == 0
    assert known.simpler is not None
    assert known.simpler[1] == 1


def test_a_mined_rule_has_to_fire_more_often_than_by_chance() -> None:
    (known,) = group({}, TestCase(), failed(1, Violation("mined", "part", "mined count")), trial=0, types={})
    known.rate = proportion(1, 20)
    assert not known.confirmed
    known.rate = proportion(20, 20)
    assert known.confirmed


def test_stranger_injections_are_left_out_of_a_case() -> None:
    (known,) = group({}, TestCase(injections=(PLAIN, STRANGE)), failed(2), trial=0, types={})
    assert next(case.injections for case in plainer(known)) == (PLAIN,)


def test_the_stranger_an_injection_the_harder_is_its_case_to_explain() -> None:
    """What has no fields cannot be in a rule; a value of another type, or one that is no number, has no limits."""
    types = {("cmd", "x"): "double"}
    cut, missing = Injection("cmd", fault="truncate", value=3), Injection("cmd", "x", fault="omit")
    injections = (cut, missing, Injection("cmd", "x", "text"), STRANGE, PLAIN)
    (cut_, _), (missing_, _), (text, _), (nan, _), (plain, _) = (complexity([one], 1, types) for one in injections)
    assert cut_ > missing_ == text > nan > plain


def test_names_and_severity() -> None:
    assert finding_id(WORN).startswith("crash-part-")
    assert [severity(Violation(kind, "a", kind)) for kind in ("hang", "crash", "silent")] == [
        "restart",
        "abort",
        "silent",
    ]
