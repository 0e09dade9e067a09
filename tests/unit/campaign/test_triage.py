"""What failed only after other cases, as outcomes tell it."""

from __future__ import annotations

from collections.abc import Sequence

from riot_bus.campaign.triage import AfterOthers, add_history
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

WORN = ["crash", "part", "crash in part: worn", "ValueError: worn"]


def told(before: Sequence[TestCase]) -> Outcome:
    history = {"violations": [WORN], "before": [case.digest() for case in before]}
    return Outcome(Verdict.PASS, statistics={"history": history})


def test_the_shortest_history_of_a_failure_is_kept() -> None:
    cases = [TestCase(seed=number) for number in range(5)]
    asked = {case.digest(): case for case in cases}
    found: dict[str, AfterOthers] = {}
    add_history(found, cases[3], told(cases[:3]), asked=asked)
    add_history(found, cases[2], told(cases[:1]), asked=asked)
    add_history(found, cases[4], told(cases[:4]), asked=asked)
    (only,) = found.values()
    assert only.case == cases[2]
    assert only.before == (cases[0],)
    assert only.occurrences == 3
    assert only.violation.signature == WORN[2]


def test_without_a_history_that_is_known_nothing_is_told() -> None:
    found: dict[str, AfterOthers] = {}
    add_history(found, TestCase(), Outcome(Verdict.PASS), asked={})
    add_history(found, TestCase(), told([TestCase(seed=1)]), asked={})
    assert not found
