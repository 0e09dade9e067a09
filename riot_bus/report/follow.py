"""Reports that are kept up to date during the work, so that a killed process leaves what was known until then."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from riot_bus.events import (
    AnalysisFinished,
    CampaignFinished,
    CampaignStarted,
    FindingReplayed,
    FindingWritten,
    RunEvent,
    StepStarted,
)
from riot_bus.findings.known import KnownFindings
from riot_bus.findings.steps import STEPS
from riot_bus.plugins import REPORTS
from riot_bus.report.campaign_view import CampaignView, load_campaign
from riot_bus.report.format import clean
from riot_bus.report.formats import CampaignFormat, append_summary, write_file
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError

_EXPLAINING = {step.name for step in STEPS[1:]}
"""Steps that use the findings of a campaign that has ended."""


@dataclass(frozen=True, slots=True)
class AskedReport:
    """A requested report of a campaign, and the file that it is written to; None for stdout."""

    made: CampaignFormat
    path: Path | None


def asked_report(text: str, *, out: Path) -> AskedReport:
    """Return the report that `NAME` or `NAME=FILE` requests; without a file, the format's own in the output folder.

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


def reports_of(texts: Sequence[str], folders: Mapping[str, Path]) -> dict[str, list[str]]:
    """Return the requests for each of several units, with `{unit}` replaced by the name of its folder.

    Raises:
        ConfigError: As for `asked_report`, or several units would write to one file.
    """
    found = {}
    for unit, folder in folders.items():
        found[unit] = [text.replace("{unit}", folder.name) for text in texts]
        for each in found[unit]:
            asked_report(each, out=folder)
    for text in texts if len(folders) > 1 else ():
        if "=" in text and "{unit}" not in text:
            hint = f"write {{unit}} into its name, or leave it out: {text.partition('=')[0]}"
            raise ConfigError(f"{len(folders)} units would write to {text!r}", where="--report", hint=hint)
    return found


class ReportFollower:
    """Event listener that rewrites reports of a campaign when there is more to report; a context manager.

    Reports without a file are printed once, at the end. However the work ends, the reports say how.

    Args:
        known: The baseline, if findings that it knows do not count.
        lenient: Whether faults of the environment do not count as errors.
    """

    def __init__(
        self,
        asked: Iterable[AskedReport],
        out: Path,
        say: Callable[[str | bytes], object],
        *,
        known: KnownFindings | None = None,
        lenient: bool = False,
    ) -> None:
        self._asked, self._out, self._say = tuple(asked), out, say
        self._known, self._lenient = known.entries if known else None, lenient
        self._unit = self._fingerprint = ""
        self._finished = self._excused = False
        self._remarks: list[str] = []

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
            self._excused = self._lenient and isinstance(error, EnvironmentFaultError)
            with suppress(ConfigError):  # the reason for the end is reported instead
                self._end(_told(error))

    def __call__(self, event: RunEvent) -> None:
        """Update the reports after an event."""
        match event:
            case CampaignStarted():
                self._unit, self._fingerprint, self._finished = event.unit, event.fingerprint, False
            case CampaignFinished() | AnalysisFinished():
                self._finished = True
            case StepStarted() if event.step in _EXPLAINING:
                self._finished = True
            case FindingReplayed() if event.text:
                self._remarks.append(event.text)
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
                with suppress(OSError):  # then writing fails, which is reported
                    each.path.parent.mkdir(parents=True, exist_ok=True)
                write_file(each.made.render_campaign(view), each.path)
        return view

    def _view(self, problem: str) -> CampaignView:
        """Return what is known; nothing until the tested code is known: the folder may hold an older campaign."""
        told = self._finished or self._fingerprint
        if not self._asked or not told:
            view = CampaignView(self._out, None, (), problem=problem)
        else:
            of_it = {"unit": self._unit, "fingerprint": self._fingerprint}
            view = load_campaign(self._out, finished=self._finished, problem=problem, **of_it)
        return replace(view, known=self._known, remarks=tuple(self._remarks), excused=self._excused)


def _told(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    text = error.message if isinstance(error, RiotError) else f"{type(error).__name__}: {error}"
    return clean(text, limit=600)
