"""A campaign as annotations of GitHub Actions, and as Markdown for the summary of the job.

An annotation is a line of output that the runner takes as a command. It is written as bytes: in texts, commands are
disarmed (`vocabulary.redaction.without_commands`).
"""

from __future__ import annotations

from collections.abc import Iterator

from riot_bus.findings.known import title_of
from riot_bus.report.campaign_view import CampaignView, level_of
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean, share_interval
from riot_bus.report.location import find_place
from riot_bus.report.markdown import MarkdownReport
from riot_bus.vocabulary.counting import counted

_MOST = 10
"""Number of annotations of a kind that GitHub shows for one step."""


class GithubReport:
    """The report format `github`.

    Attributes:
        summary_variable: Environment variable that names the file whose Markdown GitHub shows with the job.
    """

    file = ""
    summary_variable = "GITHUB_STEP_SUMMARY"

    def render_campaign(self, view: CampaignView) -> bytes:
        """Return a command line for each finding that counts, up to a limit, worst first, and one for the result."""
        return "".join(f"{line}\n" for line in _commands(view)).encode()

    def render_summary(self, view: CampaignView) -> str:
        """Return what is appended to the file of `summary_variable`."""
        return MarkdownReport().render_campaign(view)


def _commands(view: CampaignView) -> Iterator[str]:
    counting = view.failures
    for one in counting[:_MOST]:
        place = find_place(one)
        about = {
            "file": place.path,
            "line": str(place.line),
            "title": clean(title_of(one.finding), limit=200),  # GitHub takes 255 characters
        }
        yield _command(level_of(one.finding), about, _message(one, told=view.told(one) if view.entry(one) else ""))
    told = "\n".join([view.verdict, *view.remarks])
    if len(counting) > _MOST:
        left = counted(len(counting) - _MOST, "finding")
        told += f" ({left} without an annotation: GitHub shows {_MOST} of a step)"
    clean_end = view.finished and not view.doubts and not view.problem
    level = "error" if view.problem and not view.excused else "notice" if clean_end else "warning"
    yield _command(level, {"title": "riot"}, told)


def _message(one: FindingView, *, told: str) -> str:
    finding, rate = one.finding, one.finding.rate
    lines = [one.verdict_text, *([told] if told else []), *finding.details[:1]]
    if rate:
        often = share_interval(rate.low, rate.high)
        lines.append(f"{rate.count} of {counted(rate.total, 'fresh trial')} failed again, 95 %: {often}")
    return "\n".join([*lines, one.command("reproduce")])


def _command(name: str, about: dict[str, str], message: str) -> str:
    properties = ",".join(f"{key}={_escaped(clean(text, limit=1000), more=':,')}" for key, text in about.items())
    return f"::{name} {properties}::{_escaped(clean(message, limit=2000, lines=True))}"  # it takes 64 KB


def _escaped(text: str, *, more: str = "") -> str:
    """Return text with escapes for what ends a command, and for `more`, which ends a property of one."""
    for letter in f"%\r\n{more}":
        text = text.replace(letter, f"%{ord(letter):02X}")
    return text
