"""A finding, or a campaign, as Markdown for issues, comments and summaries of jobs: the counterpart of the page.

Untrusted text is written as code, where it is neither markup nor a link, and mentions nobody.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from html import escape

from riot_bus.findings.known import title_of
from riot_bus.report.campaign_view import CampaignView
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean, share_interval, value
from riot_bus.report.location import find_place
from riot_bus.report.statements import not_tried, statements
from riot_bus.report.text import TextReport
from riot_bus.vocabulary.counting import counted

LONGEST = 65_536
"""Largest number of characters in a comment on GitHub."""
_PLAIN = re.compile(r"(?!.*(?:www\.|//))[A-Za-z0-9 \N{NO-BREAK SPACE}.,;:%()'<>=+/-]*", re.IGNORECASE)
_ENTITY = re.compile(r"[!-/:-@\[-`{-~]")
_LONGEST_CELL = 300  # rows have up to seven cells: 30 of the longest fit into a comment
_MOST = 20  # lines of up to 1,000 characters, rows of five cells: each less than half a comment


class MarkdownReport:
    """The report format `markdown`."""

    file = ""

    def render(self, view: FindingView) -> str:
        """Return all that is known of a finding, as far as it fits into a comment."""
        return bounded(list(_finding(view)), where=f"riot report {view.directory}")

    def render_campaign(self, view: CampaignView) -> str:
        """Return a table of all findings, what is in doubt, and what is known of each, as far as it fits."""
        return bounded(list(_campaign(view)), where=f"riot findings {view.folder}")


def bounded(parts: list[str], *, where: str, longest: int = LONGEST) -> str:
    """Return the first parts that fit, how many were left out, and the command that shows everything."""
    room, kept = longest - len(_left_out(len(parts), where)), list[str]()
    if sum(map(len, parts)) <= longest:
        return "".join(parts)
    for part in parts:
        room -= len(part)
        if room < 0:
            break
        kept.append(part)
    return "".join([*kept, _left_out(len(parts) - len(kept), where)])


def _left_out(count: int, where: str) -> str:
    return f"\n\n{counted(count, 'part')} left out, as GitHub takes {LONGEST} characters: {code(where)} tells all.\n"


def _campaign(view: CampaignView) -> Iterator[str]:
    yield f"## riot: {_inline(view.verdict)}\n"
    told_too = ("baseline",) if view.known is not None else ()
    if view.current:
        yield _heads("failure", "component", "severity", "fresh trials (95 %)", "fails when", "again", *told_too)
    for one in view.current:
        finding, rate = one.finding, one.finding.rate
        often = f"{rate.count} of {rate.total} ({share_interval(rate.low, rate.high)})" if rate else "not repeated"
        rule = cell(one.rule.text) if one.rule else "not known yet"
        failure, again = cell(title_of(finding)), cell(one.command("reproduce"))
        facts = [failure, cell(finding.component), cell(finding.severity), often, rule, again]
        yield f"| {' | '.join([*facts, *([cell(view.told(one))] if told_too else [])])} |\n"
    campaign = view.campaign
    told = [("Doubts", view.doubts), ("Stopped early", [view.problem] if view.problem else [])]
    told.append(("Played again", list(view.remarks)))
    if campaign:
        told.append(("Not confirmed", [one.signature for one in campaign.unconfirmed]))
        told.append(("Not told", list(campaign.untold)))
    told.append(("Found with other code, not seen again", [one.directory.name for one in view.earlier]))
    for title, lines in told:
        yield from _listed(title, lines)
    if campaign:
        yield from _listed("Injections", campaign.effects.lines())
    for one in view.current:
        yield from _finding(one)


def _finding(view: FindingView) -> Iterator[str]:
    verdict = "".join(code(part.text) if part.code else _inline(part.text) for part in view.verdict())
    yield f"\n### {code(clean(view.finding.id, limit=100))} ({view.severity})\n\n{verdict}\n"
    yield f"\nAt {code(str(find_place(view)))}:\n"
    if view.finding.details:
        yield f"\n{_block(view.finding.details[:_MOST])}"
    yield f"\n{_block(TextReport().render(view).splitlines()[1:])}"
    if view.fields and view.fields.fields:
        yield _heads("field", "fails with", "passes with", "failing log", "passing log")
    for field in view.fields.fields[:_MOST] if view.fields else ():
        proof = field.certificate
        pair = [value(proof.failing), value(proof.passing), proof.failing_log, proof.passing_log]
        yield f"| {' | '.join(map(cell, [field.name, *pair]))} |\n"
    yield _heads("what", "behind it", "how sure")
    for one in statements(view):
        yield f"| {cell(one.claim)} | {cell(one.evidence)} | {cell(one.confidence)} |\n"
    yield from _listed("What was not tried", not_tried(view))


def _heads(*names: str) -> str:
    return f"\n| {' | '.join(names)} |\n{'|---' * len(names)}|\n"


def _listed(title: str, lines: Iterable[str]) -> Iterator[str]:
    for place, line in enumerate(lines):
        head = "" if place else f"\n**{title}**\n\n"
        yield f"{head}- {_inline(line)}\n"


def _inline(text: str) -> str:
    """Return plain text as it is, and text with anything that may be markup or a name as code."""
    return escape(text, quote=False) if _PLAIN.fullmatch(text) else code(text)


def code(text: str) -> str:
    """Return a text in one line as code."""
    text = clean(text, limit=4 * _LONGEST_CELL) or " "
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence, ends = "`" * (longest + 1), text[:1] + text[-1:]
    pad = " " if "`" in ends or (ends == "  " and text.strip(" ")) else ""
    return f"{fence}{pad}{text}{pad}{fence}"


def cell(text: str) -> str:
    """Return a text for a cell of a table; a text with a bar, which ends a cell even in code, is written as HTML."""
    text = clean(text, limit=_LONGEST_CELL)
    if "|" in text:
        return f"<code>{_ENTITY.sub(lambda found: f'&#{ord(found[0])};', text)}</code>"
    return _inline(text)


def _block(lines: Iterable[str]) -> str:
    """Return lines as a block of code that none of them ends."""
    text = "\n".join(clean(line, limit=1000, lines=True) for line in lines)
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}text\n{text}\n{fence}\n"
