"""Events of a running chain, as one typed stream that consoles, files and reports listen to."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RunEvent:
    """One event; plain values only, so that it can be written as JSON."""

    def as_json(self) -> dict[str, Any]:
        """Return the event as JSON values: the name of its class as `event`, and its attributes."""
        return {"event": type(self).__name__, **asdict(self)}


Listener = Callable[[RunEvent], None]
"""Called with every event, in order, on the thread that does the work."""


@dataclass(frozen=True, slots=True)
class StepStarted(RunEvent):
    """A step begins: one of the chain, or another piece of work such as `record`."""

    step: str


@dataclass(frozen=True, slots=True)
class StepProgress(RunEvent):
    """A step has made progress.

    Attributes:
        done: Number of trials (or whatever is counted) so far.
        total: Final number; None if it is not known.
        note: Human-readable description of the current work.
        left: Seconds until it ends in any case; None if no time was given.
    """

    step: str
    done: int
    total: int | None
    note: str
    left: float | None = None


@dataclass(frozen=True, slots=True)
class TimeLeft(RunEvent):
    """The remaining and the given time for all of the work, in seconds, reported when a part of it begins."""

    seconds: float
    total: float


@dataclass(frozen=True, slots=True)
class TrialFinished(RunEvent):
    """A trial has a result, by executing it or from the store of earlier trials.

    Attributes:
        step: Name of the step that asked for the trial, as in `StepStarted`.
        verdict: `pass`, `fail`, `error` or `unjudged`.
        signature: Signature of the failure, if it failed.
        detail: Observation of the first monitor, or what went wrong.
        seconds: Duration of its execution.
    """

    step: str
    verdict: str
    signature: str | None
    detail: str
    seconds: float


@dataclass(frozen=True, slots=True)
class CampaignStarted(RunEvent):
    """A unit's test begins; the fingerprint is a hash of the system file and of the code under test."""

    unit: str
    fingerprint: str


@dataclass(frozen=True, slots=True)
class FindingWritten(RunEvent):
    """A distinct failure has been written to a folder; so many failing trials of the campaign had its signature."""

    step: str
    folder: str
    id: str
    signature: str
    occurrences: int


@dataclass(frozen=True, slots=True)
class FindingReplayed(RunEvent):
    """The log of an earlier finding was played to fresh components.

    Attributes:
        answer: `still failing`, `fixed`, `failing otherwise`, or `not decided`.
        text: Human-readable result in one line.
        failed: Number of trials that failed as before.
    """

    folder: str
    title: str
    answer: str
    text: str
    failed: int
    trials: int


@dataclass(frozen=True, slots=True)
class StepFinished(RunEvent):
    """A step has ended.

    Attributes:
        text: Human-readable result in one line.
        seconds: Time since it began.
        trials: Number of trials that it requested, whether executed now or earlier.
        folder: Folder that holds its record, if it wrote one.
        record: The record, as in its file.
    """

    step: str
    text: str
    seconds: float
    trials: int = 0
    folder: str | None = None
    record: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class StepStopped(RunEvent):
    """A step has no result for a finding, and `text` says why, so the chain ends there."""

    step: str
    text: str
    folder: str


@dataclass(frozen=True, slots=True)
class CampaignFinished(RunEvent):
    """All trials of a unit's test are done.

    Attributes:
        exhausted: Whether the budget of trials was used up, or all was tried; False if the campaign ended earlier.
        findings: Folders of the findings, most frequent failure first.
    """

    unit: str
    trials: int
    failing: int
    exhausted: bool
    findings: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, slots=True)
class AnalysisFinished(RunEvent):
    """A finding has gone through the chain.

    Attributes:
        report: Report page of the finding.
        stopped: Reason why the chain ended early; empty if it did not.
    """

    folder: str
    report: str
    stopped: str


class Listeners:
    """Passes events on to several listeners, in order; the failure of one is reported once and stops nothing."""

    def __init__(self, listeners: Iterable[Listener] = ()) -> None:
        self._listeners = tuple(listeners)
        self._failed: set[int] = set()

    def __call__(self, event: RunEvent) -> None:
        """Pass an event to all listeners."""
        for place, listener in enumerate(self._listeners):
            try:
                listener(event)
            except Exception:  # a listener may raise anything, but the work must continue
                if place not in self._failed:
                    self._failed.add(place)
                    told = f"{getattr(listener, '__name__', type(listener).__name__)} on {type(event).__name__}"
                    _LOG.warning("riot: a listener failed (%s); the work goes on", told, exc_info=True)
