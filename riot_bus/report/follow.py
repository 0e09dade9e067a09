"""Reports that are kept up to date while work goes on, so that a kill leaves what was known until then."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

from riot_bus.events import AnalysisFinished, CampaignFinished, CampaignStarted, FindingWritten, StepStarted
from riot_bus.findings.steps import STEPS
from riot_bus.plugins import REPORTS
from riot_bus.report.campaign_view import CampaignView, load_campaign
from riot_bus.report.format import clean
from riot_bus.report.formats import CampaignFormat, append_summary, write_file
from riot_bus.vocabulary.errors import ConfigError, RiotError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import TracebackType

    from riot_bus.events import RunEvent

__all__ = ["AskedReport", "ReportFollower", "asked_report"]

_EXPLAINING = {step.name for step in STEPS[1:]}
"""Steps that take the findings of a campaign that has ended."""


@dataclass(frozen=True, slots=True)
class AskedReport:
    """A report that somebody wants of a campaign.

    Attributes:
        path: File that it is written to; None for stdout.
    """

    made: CampaignFormat
    path: Path | None


def asked_report(text: str, *, out: Path) -> AskedReport:
    """Return what `NAME` or `NAME=FILE` asks for.

    Args:
        text: Name of the format, and the file; without one, where the format's own file stands in the output folder.
        out: The output folder.

    Raises:
        ConfigError: There is no such format, it does not report campaigns, or the file has no name.
    """
    name, equals, file = text.partition("=")
    made = REPORTS.load(name, where="--report")()
    if not isinstance(made, CampaignFormat):
        raise ConfigError(
            f"report format {name!r} is of one finding, not of a campaign",
            where="--report",
            hint=f"junit, sarif, markdown or github; `riot report FINDING --format {name}` for one finding",
        )
    if equals and not file:
        raise ConfigError(f"{text!r} names no file", where="--report", hint=f"{name} or {name}=FILE")
    path = Path(file) if file else out / made.file if made.file else None
    return AskedReport(made, path)


class ReportFollower:
    """Listens to events and writes reports of a campaign anew when there is more to report; a context manager.

    What has no file is printed once, at the end. However the work ends, the reports say how.

    Args:
        asked: The reports.
        out: The campaign's output folder.
        say: Prints.
    """

    def __init__(self, asked: Iterable[AskedReport], out: Path, say: Callable[[str | bytes], object]) -> None:
        self._asked, self._out, self._say = tuple(asked), out, say
        self._unit = self._fingerprint = ""
        self._finished = False

    def __enter__(self) -> Self:
        """Write that nothing is known yet.

        Raises:
            ConfigError: A file cannot be written.
        """
        self._write()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self._finished = True
            self._end()
        else:
            with suppress(ConfigError):  # why the work has ended is told, not this
                self._end(_told(error))

    def __call__(self, event: RunEvent) -> None:
        """Write what an event has brought."""
        match event:
            case CampaignStarted():
                self._unit, self._fingerprint, self._finished = event.unit, event.fingerprint, False
            case CampaignFinished() | AnalysisFinished():
                self._finished = True
            case StepStarted() if event.step in _EXPLAINING:
                self._finished = True
            case FindingWritten():
                pass
            case _:
                return
        self._write()

    def _end(self, problem: str = "") -> None:
        view = self._write(problem)
        for each in self._asked:
            if each.path is None:
                self._say(each.made.render_campaign(view))
            append_summary(each.made, view)

    def _write(self, problem: str = "") -> CampaignView:
        view = self._view(problem)
        for each in self._asked:
            if each.path is not None:
                with suppress(OSError):  # then it cannot be written, which is told
                    each.path.parent.mkdir(parents=True, exist_ok=True)
                write_file(each.made.render_campaign(view), each.path)
        return view

    def _view(self, problem: str) -> CampaignView:
        """Return what is known; nothing before it is known what is tested: the folder may hold an older campaign."""
        known = self._finished or self._fingerprint
        if not self._asked or not known:
            return CampaignView(self._out, None, (), problem=problem)
        unit, fingerprint = self._unit, self._fingerprint
        return load_campaign(self._out, finished=self._finished, unit=unit, fingerprint=fingerprint, problem=problem)


def _told(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    text = error.message if isinstance(error, RiotError) else f"{type(error).__name__}: {error}"
    return clean(text, limit=600)
