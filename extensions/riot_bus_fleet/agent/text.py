"""Robots and their operations as lines for people; pure. Control characters from the network are escaped."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from riot_bus.play.text import speed
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus_fleet.agent.remote_operation import Robot


def robot_lines(robots: Sequence[Robot]) -> list[str]:
    """Return a line for each robot and what it does."""
    lines = []
    for each in robots:
        if each.agents > 1:
            what = f"{each.agents} agents have this name: none of them plays or records"
        elif each.status is None:
            what = "there, but does not answer"
        else:
            operation = each.status.get("operation")
            busy = bool(each.status.get("busy"))
            what = operation_line(operation) if busy and isinstance(operation, dict) else "idle"
        lines.append(escape_control_chars(f"{each.name}: {what}"))
    return lines


def status_lines(status: Mapping[str, Any]) -> list[str]:
    """Return an agent's status, its answer to most commands."""
    operation = status.get("operation")
    lines = [
        f"{status.get('robot')}: riot_bus {status.get('version')}, process {status.get('pid')}, "
        f"up for {_number(status.get('uptime')):.0f} s, bus {status.get('bus')}"
    ]
    if isinstance(operation, dict):
        lines.append(operation_line(operation))
        lines.append(f"for {operation.get('who')}; {_policy(operation)}")
        lines += [f"warning: {each}" for each in _texts(operation.get("warnings"))]
    else:
        lines.append("idle")
    return [escape_control_chars(line) for line in lines]


def operation_line(operation: Mapping[str, Any]) -> str:
    """Return one line about how an operation proceeds, or how it ended."""
    logs = ", ".join(_texts(operation.get("logs")))
    parts = [" ".join(filter(None, [str(operation.get("state")), str(operation.get("kind")), logs]))]
    if "position" in operation:
        parts.append(f"{_number(operation['position']):.1f} of {_number(operation.get('end')):.1f} s")
        parts.append(speed(_number(operation.get("rate"))))
    for name, unit in (("published", "messages"), ("recorded", "messages")):
        if name in operation:
            parts.append(f"{_number(operation[name]):.0f} {unit}")
    if _number(operation.get("lost")):
        parts.append(f"{_number(operation['lost']):.0f} lost")
    problem = operation.get("problem")
    if isinstance(problem, dict):
        parts.append(str(problem.get("message")))
    elif operation.get("reason"):
        parts.append(str(operation["reason"]))
    return escape_control_chars(", ".join(parts))


def silence_line(seconds: float) -> str:
    """Return what to say while nothing is heard."""
    return f"nothing heard for {seconds:.0f} s; trying on"


def log_lines(answer: Mapping[str, Any]) -> list[str]:
    """Return the logs that an agent has."""
    logs = answer.get("logs")
    rows = [each for each in logs if isinstance(each, dict)] if isinstance(logs, list) else []
    lines = []
    for row in rows:
        state = "" if not row.get("problem") and not row.get("lost") else f"  {row.get('problem') or 'damaged'}"
        lines.append(
            escape_control_chars(
                f"{_moment(row.get('start'))}  {_number(row.get('seconds')):8.1f} s  "
                f"{_number(row.get('messages')):9.0f} messages  {row.get('name')}{state}"
            )
        )
    count = int(_number(answer.get("count")))
    if count > len(rows):
        lines.append(f"and {count - len(rows)} more")
    if not answer.get("complete"):
        lines.append("it is still looking at its logs; ask again for the rest")
    return lines or ["no log"]


def _policy(operation: Mapping[str, Any]) -> str:
    policy = operation.get("on_lost_controller")
    what = {"continue": "goes on", "pause": "pauses", "stop": "stops"}.get(str(policy), str(policy))
    away = _number(operation.get("controller_away"))
    after = f" (not seen for {away:.0f} s)" if away > 1 else ""
    return f"{what} if the controller is lost for {_number(operation.get('grace')):g} s{after}"


def _texts(value: Any) -> list[str]:
    return [str(each) for each in value[:20]] if isinstance(value, list) else []


def _number(value: Any) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e20
    return float(value) if good and math.isfinite(value) else 0.0


def _moment(time: Any) -> str:
    seconds = _number(time) / 1e9
    if not 0 < seconds < 9e9 or not isinstance(time, int):
        return "-".ljust(19)
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")
