"""Report formats for a finding or a whole campaign: their interfaces, and how a report is written to a file.

Formats of other packages are found by the entry points `riot_bus.reports`; `riot_bus_testkit.reports` tests them.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Protocol, runtime_checkable

from riot_bus.findings.known import KnownFindings
from riot_bus.findings.records import FindingRecord
from riot_bus.new_file import write_whole
from riot_bus.report.campaign_view import CampaignView, as_campaign, load_campaign
from riot_bus.report.finding_view import FindingView, load
from riot_bus.vocabulary.errors import ConfigError


@runtime_checkable
class ReportFormat(Protocol):
    """A format for reports of one finding; a class without arguments.

    Attributes:
        file: Name of the file in the finding's folder that it is written to; empty for stdout.
    """

    file: str

    def render(self, view: FindingView) -> str | bytes:
        """Return the report; texts in the view come from others, and may hold anything.

        Raises:
            MissingExtraError: An optional dependency is not installed.
        """
        ...


@runtime_checkable
class CampaignFormat(Protocol):
    """A format for reports of all that a campaign has found; it may be a `ReportFormat`, too.

    Attributes:
        file: Name of the file in the output folder that it is written to; empty for stdout.
    """

    file: str

    def render_campaign(self, view: CampaignView) -> str | bytes:
        """Return the report; texts in the view come from others, and may hold anything.

        Raises:
            MissingExtraError: An optional dependency is not installed.
        """
        ...


@runtime_checkable
class SummaryFormat(Protocol):
    """A format that, once the work has ended, also adds to the file that an environment variable names."""

    summary_variable: str

    def render_summary(self, view: CampaignView) -> str:
        """Return the text to add."""
        ...


def view_of(folder: Path) -> FindingView | CampaignView:
    """Read a finding, or an output folder.

    Raises:
        ConfigError: `finding.json` is unusable.
    """
    return load(folder) if FindingRecord.exists(folder) else load_campaign(folder)


def render(made: ReportFormat | CampaignFormat, view: FindingView | CampaignView) -> str | bytes:
    """Return a report of a finding or a campaign.

    A format that knows only campaigns gets a finding as a campaign that has found nothing else.

    Raises:
        ConfigError: A campaign is to be reported, and the format knows only findings.
    """
    if isinstance(view, FindingView) and isinstance(made, ReportFormat):
        return made.render(view)
    if not isinstance(made, CampaignFormat):
        raise ConfigError("this format reports one finding, not a campaign", hint="name the folder of a finding")
    return made.render_campaign(as_campaign(view))


def beside_baseline(made: object, view: FindingView | CampaignView, path: Path) -> CampaignView:
    """Return a view in which the findings that a baseline knows do not count.

    Raises:
        ConfigError: There is no such file, it is unusable, or the format does not show which findings are known.
    """
    if not isinstance(made, CampaignFormat):
        hint = "take one of those that report a campaign, such as junit, sarif or markdown"
        raise ConfigError("this format does not tell which findings are known", where="--baseline", hint=hint)
    known = KnownFindings.load(path)
    if known.missing:
        raise ConfigError("there is no such baseline", where=str(path), hint="riot ci accept writes one")
    return replace(as_campaign(view), known=known.entries)


def append_summary(made: object, view: FindingView | CampaignView) -> None:
    """Add to the file that a format's environment variable names, if the format has one and it is set.

    Raises:
        ConfigError: It cannot be written there.
    """
    if not isinstance(made, SummaryFormat) or not (path := os.environ.get(made.summary_variable)):
        return
    text = made.render_summary(as_campaign(view))
    try:
        with open(path, "a", encoding="utf-8") as stream:
            stream.write(text)
    except OSError as error:
        where = f"{made.summary_variable}={path}"
        raise ConfigError(f"cannot add to the summary: {error.strerror}", where=where) from error


def write_file(content: str | bytes, path: Path) -> Path:
    """Write a report atomically, so that a reader never sees half of it; return its path.

    Raises:
        ConfigError: It cannot be written there.
    """
    try:
        write_whole(path, content, sync=False)
    except OSError as error:
        raise ConfigError(f"cannot write the report: {error.strerror}", where=str(path)) from error
    return path
