"""What happens while the chain works, as one stream of typed events that consoles, files and reports listen to."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

__all__ = [
    "AnalysisFinished",
    "CampaignFinished",
    "CampaignStarted",
    "FindingReplayed",
    "FindingWritten",
    "Listener",
    "Listeners",
    "RunEvent",
    "StepFinished",
    "StepProgress",
    "StepStarted",
    "StepStopped",
    "TimeLeft",
    "TrialFinished",
]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RunEvent:
    """One event; plain values only, so that it can be written as JSON."""

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON's kinds of values: the name of its class as `event`, and its attributes."""
        return {"event": type(self).__name__, **asdict(self)}


Listener = Callable[[RunEvent], None]
"""Is told of everything that happens, in order, on the thread that does the work."""


@dataclass(frozen=True, slots=True)
class StepStarted(RunEvent):
    """A step begins: one of the chain, or another piece of work such as `record`."""

    step: str


@dataclass(frozen=True, slots=True)
class StepProgress(RunEvent):
    """A step has got on.

    Attributes:
        done: Trials (or what else is counted) so far.
        total: How many there will be; None if that is not known.
        note: What goes on, for people.
        left: Seconds until it ends in any case; None if no time was given.
    """

    step: str
    done: int
    total: int | None
    note: str
    left: float | None = None


@dataclass(frozen=True, slots=True)
class TimeLeft(RunEvent):
    """How much is left of the time that was given for all of the work, told when a part of it begins.

    Attributes:
        seconds: So much is left.
        total: So much was given.
    """

    seconds: float
    total: float


@dataclass(frozen=True, slots=True)
class TrialFinished(RunEvent):
    """A trial has been answered, by executing it or by the store of earlier trials.

    Attributes:
        verdict: `pass`, `fail`, `error` or `unjudged`.
        signature: The failure's, if it failed.
        detail: What the first monitor saw, or what went wrong.
        seconds: How long it took when it was executed.
    """

    step: str
    verdict: str
    signature: str | None
    detail: str
    seconds: float


@dataclass(frozen=True, slots=True)
class CampaignStarted(RunEvent):
    """A unit's test begins.

    Attributes:
        fingerprint: Of what is tested: a hash of the system file and of the code.
    """

    unit: str
    fingerprint: str


@dataclass(frozen=True, slots=True)
class FindingWritten(RunEvent):
    """A distinct failure has got a folder.

    Attributes:
        occurrences: Failing trials of the campaign with its signature.
    """

    step: str
    folder: str
    id: str
    signature: str
    occurrences: int


@dataclass(frozen=True, slots=True)
class FindingReplayed(RunEvent):
    """The log of a finding that was there before was played to fresh components.

    Attributes:
        folder: Where the log is kept.
        title: What the finding is called.
        answer: `still failing`, `fixed`, `failing otherwise`, or `not decided`.
        text: What has become of it, in a line for people.
        failed: Trials that failed as before.
    """

    folder: str
    title: str
    answer: str
    text: str
    failed: int
    trials: int


@dataclass(frozen=True, slots=True)
class StepFinished(RunEvent):
    """A step has come to its end.

    Attributes:
        text: What it has come to, in a line for people.
        seconds: Time since it began.
        trials: Trials that it asked for, whether executed now or earlier.
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
    """A step cannot say anything about a finding, so the chain ends there.

    Attributes:
        text: Why, for people.
        folder: Folder of the finding.
    """

    step: str
    text: str
    folder: str


@dataclass(frozen=True, slots=True)
class CampaignFinished(RunEvent):
    """All trials of a unit's test are done.

    Attributes:
        failing: Trials that failed.
        exhausted: Whether the budget of trials was used up; False if time ran out first.
        findings: Folders, most frequent failure first.
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
        report: The page about it.
        stopped: Why the chain ended early; empty if it did not.
    """

    folder: str
    report: str
    stopped: str


class Listeners:
    """Passes events on to several listeners; the failure of one is reported once and stops nothing.

    Args:
        listeners: Whom to tell, in this order.
    """

    def __init__(self, listeners: Iterable[Listener] = ()) -> None:
        self._listeners = tuple(listeners)
        self._failed: set[int] = set()

    def __call__(self, event: RunEvent) -> None:
        """Tell all listeners."""
        for place, listener in enumerate(self._listeners):
            try:
                listener(event)
            except Exception:  # a listener may raise anything, and the work goes on
                if place not in self._failed:
                    self._failed.add(place)
                    told = f"{getattr(listener, '__name__', type(listener).__name__)} on {type(event).__name__}"
                    _LOG.warning("riot: a listener failed (%s); the work goes on", told, exc_info=True)
