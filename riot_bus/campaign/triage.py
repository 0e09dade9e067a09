"""Triage: failures with one signature are one finding (RIOT II-A), once fresh trials of it have failed again."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.vocabulary.trial import Outcome, TestCase, Violation

if TYPE_CHECKING:
    from riot_bus.statistics.rates import Proportion
    from riot_bus.vocabulary.injection import Injection

Types = Mapping[tuple[str, str], str]
"""Types of fields by topic and path; of a length (`len(data)`) that never varies it is `FIXED`."""

FIXED = "fixed"

_SEVERITY = {"hang": "restart", "crash": "abort", "exit": "abort", "limit": "abort"}
_MALFORMED = 2  # on the scale of `_strangeness`
_MINED_ALARMS = 0.01
"""Share of nominal trials in which mined rules may fire by chance (docs/verdicts.md)."""


@dataclass(slots=True)
class Failure:
    """All failures of one signature so far.

    Attributes:
        case: The simplest case that was repeated, or the simplest one if none was.
        occurrences: Number of trials of the campaign that failed this way.
        rate: Rate of this failure in fresh trials of the case; None while there were none.
        nominal: Rate of this failure in trials of the nominal log.
        simpler: A simpler case that failed this way later, with its trial and outcome.
    """

    violation: Violation
    case: TestCase
    trial: int
    outcome: Outcome
    modified: int
    occurrences: int = 0
    rate: Proportion | None = None
    nominal: Proportion | None = None
    details: list[str] = field(default_factory=list)
    simpler: tuple[TestCase, int, Outcome] | None = None
    attempts: int = 0
    tried: set[int] = field(default_factory=set)
    others: list[TestCase] = field(default_factory=list)
    types: Types = field(default_factory=dict)

    @property
    def confirmed(self) -> bool:
        """Whether fresh trials have failed this way again; for a mined rule, more often than by chance."""
        if self.rate is None or not self.rate.hits:
            return False
        return self.violation.monitor != "mined" or self.rate.low > _MINED_ALARMS

    @property
    def complexity(self) -> tuple[int, int]:
        """How hard its case is to explain."""
        return complexity(self.case.injections, self.modified, self.types)

    @property
    def malformed(self) -> bool:
        """Whether all cases known to fail this way have payloads that a sender that works would not send."""
        return self.complexity[0] >= _MALFORMED

    @property
    def played(self) -> int:
        """Messages of the case that were played before the failure; 0 if that is not known."""
        return int(self.outcome.statistics.get("played", 0))

    def represent_by(self, case: TestCase, trial: int, outcome: Outcome) -> None:
        """Make another case represent the failure."""
        self.case, self.trial, self.outcome, self.modified = case, trial, outcome, _modified(case, outcome)


def _modified(case: TestCase, outcome: Outcome) -> int:
    return int(outcome.statistics.get("modified", len(case.injections)))


def complexity(injections: Iterable[Injection], modified: int, types: Types) -> tuple[int, int]:
    """Return how hard a case is to explain, as a key that sorts the simplest case first.

    A rule is about values of fields; values that are not numbers have no limits, and truncated payloads have no fields.
    """
    return max((_strangeness(each, types) for each in injections), default=0), modified


def plainer(failure: Failure) -> Iterator[TestCase]:
    """Yield cases of a failure without their stranger injections: plain values among them may do the same alone.

    First come parts of its own case, the plainest first, then plainer parts of other cases.
    """
    least = failure.complexity[0]
    for case in (failure.case, *failure.others) if least else ():
        strangeness = [_strangeness(each, failure.types) for each in case.injections]
        for most in sorted(set(strangeness))[: None if case is failure.case else 1]:
            if most < least:
                kept = (each for each, one in zip(case.injections, strangeness, strict=True) if one <= most)
                yield replace(case, injections=tuple(kept))


def _strangeness(injection: Injection, types: Types) -> int:
    value = injection.value
    if injection.fault != "set":
        return {"truncate": _MALFORMED + 1, "omit": _MALFORMED}.get(injection.fault, 0)
    known = types.get((injection.topic, injection.field or ""))
    if known is not None and (known == FIXED or isinstance(value, str | bytes) != (known in ("string", "bytes"))):
        return _MALFORMED  # a length, or a value of another type, that the field cannot have
    return int(value is None or (isinstance(value, float) and not math.isfinite(value)))


def severity(violation: Violation) -> str:
    """Return the severity of a failure on the CRASH scale.

    A component that must be restarted is worse than one that ended by itself; wrong outputs and silence give no sign
    of an error.
    """
    return _SEVERITY.get(violation.monitor, "silent")


def finding_id(violation: Violation) -> str:
    """Return a short, stable, readable name for a signature, fit for a folder."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", f"{violation.monitor}-{violation.component}").strip("-").lower()
    return f"{words[:40]}-{hashlib.sha256(violation.signature.encode()).hexdigest()[:6]}"


def group(failures: dict[str, Failure], case: TestCase, outcome: Outcome, *, trial: int, types: Types) -> list[Failure]:
    """Add a failing outcome to the failures of all its signatures; return these.

    A failure keeps the simplest case: with plain values, if there is one, and the fewest modified messages. After its
    confirmation, a simpler case is kept as `simpler`.
    """
    modified = _modified(case, outcome)
    found = []
    for violation in {each.signature: each for each in outcome.violations}.values():
        known = failures.setdefault(
            violation.signature, Failure(violation, case, trial, outcome, modified, types=types)
        )
        simplest = known.complexity
        if known.simpler:
            other, _, its = known.simpler
            simplest = min(simplest, complexity(other.injections, _modified(other, its), types))
        is_simpler = complexity(case.injections, modified, types) < simplest
        if is_simpler and known.confirmed:
            known.simpler = case, trial, outcome
        elif is_simpler:
            known.represent_by(case, trial, outcome)
        elif len(known.others) < 8:
            known.others.append(case)
        known.occurrences += 1
        if violation.detail not in known.details and len(known.details) < 5:
            known.details.append(violation.detail)
        found.append(known)
    return found
