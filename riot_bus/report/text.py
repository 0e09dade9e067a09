"""One finding in a few lines of plain text."""

from __future__ import annotations

from pathlib import Path

from riot_bus.report.finding_view import FindingView, load
from riot_bus.report.format import clean, number, plural, seconds, share, share_interval

__all__ = ["summary"]


def summary(directory: Path) -> str:
    """Return what is known of a finding, for the console; nothing in it can move the terminal's cursor.

    Args:
        directory: The finding's directory.

    Raises:
        ConfigError: `finding.json` is missing or unusable.
    """
    story = load(directory)
    head = f"{clean(story.finding.id, limit=40)}  [{story.severity}]  "
    lines = [head + "".join(part.text for part in story.verdict())]
    lines += [f"  {label:<10}{text}" for label, text in _facts(story)]
    return "\n".join(lines)


def _facts(story: FindingView) -> list[tuple[str, str]]:
    finding = story.finding
    log = f"{plural(finding.messages, 'message')} ({finding.modified} modified)"
    if story.minimal:
        log += f" -> {len(story.minimal.kept)} needed"
    facts = [("signature", clean(finding.signature, limit=160)), ("log", log)]
    if story.fields:
        facts.append(("fields", ", ".join(clean(one.name, limit=80) for one in story.fields.fields[:8]) or "none"))
    if story.rule:
        precision, recall = story.rule.precision, story.rule.recall
        facts.append(
            (
                "rule",
                f"precision {share(precision.value)} ({share_interval(precision.low, precision.high)}), "
                f"recall {share(recall.value)} ({share_interval(recall.low, recall.high)})",
            )
        )
    region = story.activation.region if story.activation else None
    if region:
        x_name, y_name = clean(region.x, limit=80), clean(region.y, limit=80)
        facts.append(("region", f"{number(region.x_min)} <= {x_name} <= {number(region.x_max)}"))
        facts.append(("", f"{number(region.y_min)} <= {y_name} <= {number(region.y_max)}"))
    facts += [(clean(step.name, limit=9), clean(record.summary, limit=160)) for step, record in story.further]
    done = [record for _, record in story.steps if record]
    trials = sum(record.trials for record in done)
    spent = seconds(sum(record.seconds for record in done))
    facts.append(("effort", f"{plural(trials, 'trial')}, {spent}, seed {finding.seed}"))
    facts += [("unusable", f"{name}: {clean(reason)}") for name, reason in story.broken.items()]
    facts.append(("again", story.command("reproduce")))
    if story.next_step:
        facts.append(("next", story.command(story.next_step)))
    return facts
