"""Effects of injections: whether they reached messages, and changed outputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict


@dataclass(slots=True)
class Effects:
    """Counts over the injected trials of a campaign.

    Trials without information on what was delivered, such as those of other runners, are left out.

    Attributes:
        undelivered: Injections that changed no message that was played.
        without_effect: Delivered injections of passing trials whose outputs were those of the nominal trials.
        with_effect: Delivered injections of passing trials with outputs unlike those of all nominal trials.
        untold: Delivered injections of passing trials where outputs differ among nominal trials, too, or are missing.
    """

    injections: int = 0
    undelivered: int = 0
    without_effect: int = 0
    with_effect: int = 0
    untold: int = 0
    failing: int = 0

    def add(self, case: TestCase, outcome: Outcome, nominal: Iterable[Outcome]) -> None:
        """Count the injections of one trial; `nominal` are the outcomes of the nominal log."""
        delivered = outcome.statistics.get("delivered")
        if delivered is None or not outcome.judged:
            return
        failed = outcome.verdict is Verdict.FAIL
        count = sum(each > 0 for each in delivered)
        self.injections += len(delivered)
        self.undelivered += len(delivered) - count
        if count:
            changed = None if failed else _differs(outcome, list(nominal))
            name = "failing" if failed else {True: "with_effect", False: "without_effect", None: "untold"}[changed]
            setattr(self, name, getattr(self, name) + count)


def _differs(outcome: Outcome, nominal: Sequence[Outcome]) -> bool | None:
    """Return whether outputs (counts and payloads by topic) are unlike those of all nominal trials; None if unknown."""
    shown = outcome.statistics.get("shown")
    usual = [each for one in nominal if one.verdict is Verdict.PASS and (each := one.statistics.get("shown"))]
    if shown is None or len(usual) < len(nominal) or not usual:
        return None
    steady = True
    for topic in {*shown, *(topic for one in usual for topic in one)}:
        now, *known = (one.get(topic, (0, "")) for one in (shown, *usual))
        counts, digests = [count for count, _ in known], {digest for _, digest in known}
        if not min(counts) <= now[0] <= max(counts) or (len(digests) == 1 and now[1] not in digests):
            return True
        steady = steady and len(digests) == 1
    return False if steady else None
