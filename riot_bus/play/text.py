"""Human-readable lines about a playback; pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.play.service import PlayResult

_SIGNS = {"waiting": "…", "ready": "…", "playing": "▶", "paused": "⏸", "ended": "■"}


def speed(rate: float) -> str:
    """Return a rate as human-readable text."""
    return f"{rate:g}x" if rate else "as fast as possible"


def progress_line(status: Mapping[str, Any]) -> str:
    """Return one line about what is going on."""
    return f"{_SIGNS[status['state']]} {_where(status)}"


def _where(status: Mapping[str, Any]) -> str:
    parts = [
        status["state"],
        f"{status['position']:.1f} of {status['end']:.1f} s",
        speed(status["rate"]),
        counted(status["published"], "message"),
    ]
    if status["loop"]:
        parts.append(f"pass {status['pass']}")
    if status["lost"]:
        parts.append(f"{status['lost']} lost")
    if status["unsettled"]:
        parts.append(f"{counted(status['unsettled'], 'time')} no subscriber settled in time")
    return ", ".join(parts)


def status_lines(status: Mapping[str, Any]) -> list[str]:
    """Return the lines that show a player's answer to any command."""
    return [
        escape_control_chars(f"player {status['name']}, process {status['pid']}: {', '.join(status['logs'])}"),
        escape_control_chars(_where(status)),
        _late(status["lateness"]),
    ]


def result_line(result: PlayResult) -> str:
    """Return the summary."""
    late = result.lateness
    text = f"played {counted(result.published, 'message')} in {result.seconds:.2f} s"
    if result.passes > 1:
        text += f", {result.passes} passes"
    if late["max"]:
        text += f"; {_late(late)}"
    if result.unsettled:
        text += f"; {counted(result.unsettled, 'time')} no subscriber settled in time"
    return f"{text}; stopped before the end" if result.stopped else text


def _late(late: Mapping[str, float]) -> str:
    median, most, worst = (late[name] * 1e3 for name in ("p50", "p99", "max"))
    return f"late by {median:.2f} ms (median), {most:.2f} ms (99 %), {worst:.2f} ms (most)"
