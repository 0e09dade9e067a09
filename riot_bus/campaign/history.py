"""Failures that came after other test cases in the same process, and not with a process of their own."""

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
    """A failure that may come from what the process had before.

    Attributes:
        violation: What went wrong.
        case: The test case that failed first.
        before: Those that its process had got before, the first one first.
        occurrences: Trials that failed so.
    """

    violation: Violation
    case: TestCase
    before: tuple[TestCase, ...]
    occurrences: int = 1


def add_history(
    found: dict[str, AfterOthers], case: TestCase, outcome: Outcome, *, asked: Mapping[str, TestCase]
) -> None:
    """Add what an outcome tells of its process's history, by signature; the shortest history is kept.

    Args:
        found: What is known so far.
        case: The test case.
        outcome: Its outcome.
        asked: All cases so far, by digest. One that is not there was asked by somebody else; nothing is added then.
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
