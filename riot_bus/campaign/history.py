"""Failures that occurred after other test cases in the same process, but not in a process of their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.vocabulary.trial import Outcome, TestCase

__all__ = ["AfterOthers", "add_history"]


@dataclass(slots=True)
class AfterOthers:
    """A failure that earlier test cases in the same process may have caused.

    Attributes:
        violation: What went wrong.
        case: The test case that failed after the fewest others.
        before: Test cases that its process ran before, in order.
        occurrences: Number of trials that failed this way.
    """

    violation: Violation
    case: TestCase
    before: tuple[TestCase, ...]
    occurrences: int = 1


def add_history(
    found: dict[str, AfterOthers], case: TestCase, outcome: Outcome, *, asked: Mapping[str, TestCase]
) -> None:
    """Add the failures of an outcome that its process's history may have caused, each with its shortest history.

    Args:
        found: Failures so far, by signature.
        case: The test case.
        outcome: Its outcome.
        asked: All cases so far, by digest; if the history has others, nothing is added.
    """
    told = outcome.statistics.get("history")
    if told is None or any(digest not in asked for digest in told["before"]):
        return
    before = tuple(asked[digest] for digest in told["before"])
    for words in told["violations"]:
        violation = Violation(*map(str, words))
        known = found.get(violation.signature)
        if known is None:
            found[violation.signature] = AfterOthers(violation, case, before)
            continue
        known.occurrences += 1
        if len(before) < len(known.before):
            known.violation, known.case, known.before = violation, case, before
