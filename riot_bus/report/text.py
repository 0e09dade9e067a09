"""One finding in a few lines of plain text."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from riot_bus.findings.records import FindingRecord
from riot_bus.report.finding_view import FindingView, load
from riot_bus.report.format import clean, number, plural, seconds, share, share_interval
from riot_bus.report.statements import other_fields

_NAMES = 8  # of up to 80 letters, in one line of the console; fields.json has all


def summary(directory: Path) -> str:
    """Return what is known of a finding, for the console; nothing in it can move the terminal's cursor."""
    return TextReport().render(load(directory)).rstrip("\n")


def unchecked(folders: Iterable[Path]) -> list[str]:
    """Return a line on the findings of malformed payloads, which are told together; none if there are none."""
    found = [record for folder in folders if (record := FindingRecord.load(folder)).malformed]
    if not found:
        return []
    names = ", ".join(clean(record.id, limit=40) for record in found[:3]) + (", ..." if found[3:] else "")
    more = f'malformed = "each" in [unit.{clean(found[0].unit, limit=40)}] explains them, too'
    return [f"payloads are not checked in {plural(len(found), 'place')}: {names}; {more}"]


class TextReport:
    """The report format `text`: a few lines for a console."""

    file = ""

    def render(self, view: FindingView) -> str:
        """Return the lines; nothing in them can move the terminal's cursor."""
        return "\n".join(_lines(view)) + "\n"


def _lines(view: FindingView) -> list[str]:
    head = f"{clean(view.finding.id, limit=40)}  [{view.severity}]  "
    return [head + view.verdict_text, *(f"  {label:<10}{text}" for label, text in _facts(view))]


def _facts(view: FindingView) -> list[tuple[str, str]]:
    finding = view.finding
    log = f"{plural(finding.messages, 'message')} ({finding.modified} modified)"
    if view.minimal:
        log += f" -> {len(view.minimal.kept)} {'needed' if view.minimal.one_minimal else 'kept, not proven'}"
    facts = [("signature", clean(finding.signature, limit=160)), ("log", log)]
    facts += [("", clean(line, limit=160)) for line in (view.minimal.lines()[:5] if view.minimal else ())]
    if view.fields:
        names = [clean(one.name, limit=80) for one in view.fields.fields[:_NAMES]]
        names += [f"{clean(name, limit=80)} (unconfirmed)" for name in view.fields.unconfirmed[:_NAMES]]
        facts.append(("fields", ", ".join(names) or "none confirmed"))
        rest = other_fields(view.fields)
        facts += [("", f"{rest.claim} ({rest.confidence})")] if rest else []
    if view.rule:
        rates = {"precision": view.rule.precision, "recall": view.rule.recall}
        told = (
            f"{name} {share(one.value)} ({share_interval(one.low, one.high)})" if one.total else f"{name} not tested"
            for name, one in rates.items()
        )
        facts.append(("rule", ", ".join(told)))
    region = view.activation.region if view.activation else None
    if region:
        bounds = [clean(each, limit=160) for each in region.bounds(number)]
        facts += zip(["region", *[""] * len(bounds)], bounds, strict=False)
    facts += [(clean(step.name, limit=9), clean(record.summary, limit=160)) for step, record in view.further]
    done = [record for _, record in view.steps if record]
    trials = sum(record.trials for record in done)
    spent = seconds(sum(record.seconds for record in done))
    facts.append(("effort", f"{plural(trials, 'trial')}, {spent}, seed {finding.seed}"))
    facts += [("unusable", f"{name}: {clean(reason)}") for name, reason in view.broken.items()]
    facts.append(("again", view.command("reproduce")))
    if view.next_step:
        facts.append(("next", view.command(view.next_step)))
    return facts
