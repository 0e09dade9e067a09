"""The catalogue as lines for people; pure. Control characters from logs are escaped."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from riot_bus.config.arguments import size_text
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus.vocabulary.text_table import table_lines

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus_fleet.logs.entry import LogEntry
    from riot_bus_fleet.logs.index import IndexReport


def index_line(report: IndexReport) -> str:
    """Return the result of indexing as one line."""
    parts = [f"{report.logs} logs: {report.fresh} read, {report.logs - report.fresh} known already"]
    if report.damaged:
        parts.append(f"{report.damaged} of those read are damaged (riot fleet list damaged)")
    if report.gone:
        parts.append(f"{report.gone} gone")
    if report.pruned:
        parts.append(f"{report.pruned} forgotten")
    return ", ".join(parts)


def list_lines(entries: Sequence[LogEntry]) -> list[str]:
    """Return a table of logs."""
    rows = [("", "robot", "begin (UTC)", "length", "messages", "size", "", "log")]
    for each in entries:
        state = "gone" if each.gone else "not a log" if not each.readable else "damaged" if _lossy(each) else ""
        rows.append(
            (
                str(each.number),
                _short(each.robot, 20),
                _moment(each.start),
                f"{each.seconds:.1f} s",
                str(each.messages),
                size_text(each.size),
                state,
                escape_control_chars(each.place),
            )
        )
    return table_lines(rows, left=(1, 2, 6, 7))


def show_lines(entry: LogEntry) -> list[str]:
    """Return all that is known of a log."""
    lines = [
        f"log {entry.number}: {escape_control_chars(entry.place)}",
        f"robot {entry.robot} (as the {entry.named_by} says), {size_text(entry.size)}, profile {entry.profile or '-'}",
        f"{_moment(entry.start)} to {_moment(entry.end)} UTC, {entry.seconds:.3f} s, {entry.messages} messages",
    ]
    if entry.gone:
        lines.append("gone: it was not there when its folder was indexed last")
    if entry.problem or entry.lost:
        lines.append(f"damaged: {entry.problem or f'{entry.lost} messages are missing'}")
    told = [item for item in sorted(entry.metadata.items()) if item[0] != "options" or "command" not in entry.metadata]
    lines += [f"{name}: {_short(value, 200)}" for name, value in told]
    width = max((len(_short(each.topic)) for each in entry.topics), default=0)
    for each in entry.topics:
        touched = f", {each.originals} originals" if each.originals else ""
        kind = each.type or each.encoding or "-"
        lines.append(f"  {_short(each.topic).ljust(width)}  {each.count:>9}  {_short(kind)}{touched}")
    return [escape_control_chars(line) for line in lines]


def entry_json(entry: LogEntry) -> dict[str, Any]:
    """Return a log as JSON values."""
    from dataclasses import asdict

    return {**asdict(entry), "seconds": entry.seconds}


def answer_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the answer of a test case on each log, and how often each answer occurred."""
    lines = []
    for row in rows:
        share = f" {row['failed']} of {row['trials']}" if row["answer"] == "failed" else ""
        detail = f": {_short(row['detail'].splitlines()[0], 200)}" if row["detail"] else ""
        lines.append(escape_control_chars(f"{row['answer'] + share:<14} {row['place']}{detail}"))
    counts = {kind: sum(row["answer"] == kind for row in rows) for kind in ("fixed", "failed", "error")}
    return [*lines, f"{len(rows)} logs: " + ", ".join(f"{number} {kind}" for kind, number in counts.items())]


def _lossy(entry: LogEntry) -> bool:
    return bool(entry.problem or entry.lost)


def _short(text: str, longest: int = 60) -> str:  # topic, count and type then take at most 135 columns
    text = escape_control_chars(text)
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def _moment(time: int | None) -> str:
    if time is None:
        return "-"
    try:
        return datetime.fromtimestamp(time // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{time} ns"
