"""Triage: failures with one signature are one finding (RIOT II-A)."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.trial import Outcome, Violation

__all__ = ["Failure", "finding_id", "group", "primary"]


@dataclass(slots=True)
class Failure:
    """All failures of one signature so far; `injections` and `trial` are those of the simplest one."""

    violation: Violation
    trial: int
    injections: tuple[Injection, ...]
    played: int
    modified: int
    occurrences: int = 0
    details: list[str] = field(default_factory=list)


def primary(outcome: Outcome) -> Violation:
    """Return the violation that names a failure: the first, since crashes are judged before everything else."""
    return outcome.violations[0]


def finding_id(violation: Violation) -> str:
    """Return a short, stable, readable name for a signature, fit for a folder."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", f"{violation.monitor}-{violation.component}").strip("-").lower()
    return f"{words[:40]}-{hashlib.sha256(violation.signature.encode()).hexdigest()[:6]}"


def group(
    failures: dict[str, Failure], outcome: Outcome, *, trial: int, injections: tuple[Injection, ...], modified: int
) -> Failure:
    """Add one failing outcome to the failure of its signature, keeping the one with the fewest modified messages."""
    violation = primary(outcome)
    played = int(outcome.statistics.get("played", 0))
    known = failures.get(violation.signature)
    if known is None or modified < known.modified:
        fresh = Failure(violation, trial, injections, played, modified)
        if known is not None:
            fresh.occurrences, fresh.details = known.occurrences, known.details
        failures[violation.signature] = known = fresh
    known.occurrences += 1
    if violation.detail not in known.details and len(known.details) < 5:
        known.details.append(violation.detail)
    return known
