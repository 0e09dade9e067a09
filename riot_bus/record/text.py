"""Human-readable lines about a recording; pure. Control characters from the network are escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.config.arguments import size_text
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus.vocabulary.text_table import table_lines

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.log.account import Account
    from riot_bus.record.service import CaptureResult

_SIGNS = {"recording": "●", "paused": "⏸", "ended": "■"}
_SHOWN = 50  # rows; more would hide the summary above; the files have the account


def progress_line(status: Mapping[str, Any]) -> str:
    """Return one line about what is going on."""
    parts = [
        f"{_SIGNS.get(status['state'], '?')} {status['state']}",
        f"{status['seconds']:.0f} s",
        counted(status["messages"], "message"),
        size_text(status["bytes"]),
    ]
    if "ring" in status:
        parts.append(f"ring: {counted(status['ring']['messages'], 'message')}, {status['ring']['seconds']:.1f} s")
    if status["lost"]:
        reasons = ", ".join(f"{reason}: {number}" for reason, number in status["reasons"].items() if number)
        parts.append(f"{status['lost']} LOST ({reasons})")
    if not status["connected"]:
        parts.append("NOT CONNECTED")
    if status["problem"]:
        parts.append(f"ALARM: {status['problem']}")
    return escape_control_chars(", ".join(parts))


def answer_lines(answer: Mapping[str, Any]) -> list[str]:
    """Return the lines that show a recorder's answer to a command."""
    if "dumped" in answer:
        return [escape_control_chars(f"wrote {answer['dumped']}")]
    if "former" in answer:
        return [
            escape_control_chars(f"finished: {answer['former']}"),
            escape_control_chars(f"recording: {answer['file']}"),
        ]
    lines = [
        f"recorder {answer['name']}, riot_bus {answer['version']}, process {answer['pid']}, at {answer['endpoint']}",
        progress_line(answer),
        f"file: {answer['file'] or 'none yet'}",
    ]
    left_out = ", ".join(f"{reason}: {number}" for reason, number in answer["left_out"].items() if number)
    return [escape_control_chars(line) for line in [*lines, *([f"left out: {left_out}"] if left_out else [])]]


def result_lines(result: CaptureResult) -> list[str]:
    """Return the summary: files, and a table by topic if something is missing."""
    account = result.account
    recorded = sum(account.recorded.values())
    messages, topics = counted(recorded, "message"), counted(len(account.recorded), "topic")
    lines = [f"recorded {messages} of {topics} in {result.seconds:.1f} s"]
    for each in result.files:
        if each.deleted:
            continue
        row = each.row()
        lost = f", {row['lost']} lost" if row["lost"] else ""
        lines.append(f"  {each.path}: {counted(row['messages'], 'message')}, {size_text(each.size)}{lost}")
    gone = [each for each in result.files if each.deleted]
    if gone:
        count = sum(sum(each.account.recorded.values()) for each in gone)
        files = counted(len(gone), "older file")
        are = "is" if len(gone) == 1 else "are"
        lines.append(f"  {files} with {counted(count, 'message')} {are} deleted (--max-files)")
    lines += [f"nothing came on {each}" for each in result.silent]
    return [escape_control_chars(line) for line in [*lines, *account_lines(account)]]


def account_lines(account: Account) -> list[str]:
    """Return a table of lost and left-out messages by topic; empty if there are none."""
    columns = {
        **{reason: topics for reason, topics in sorted(account.lost.items()) if any(topics.values())},
        **{f"({reason})": topics for reason, topics in sorted(account.left_out.items()) if any(topics.values())},
    }
    topics = sorted({topic for found in columns.values() for topic, number in found.items() if number})
    if not topics:
        return []
    table = [["topic", "recorded", *columns]]
    table += [
        [topic, str(account.recorded.get(topic, 0)), *(str(found.get(topic, 0)) for found in columns.values())]
        for topic in topics[:_SHOWN]
    ]
    more = [f"... and {len(topics) - _SHOWN} topics more"] if len(topics) > _SHOWN else []
    return [escape_control_chars(line) for line in [*table_lines(table), *more]]
