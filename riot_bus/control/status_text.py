"""A router's answers as lines for people; pure. Control characters from the network are escaped."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from riot_bus.control.status import count_table
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars


def status_lines(status: Mapping[str, Any]) -> list[str]:
    """Return the lines of an answer to `status`, most important first."""
    lines = [
        f"router {status['name']}, riot_bus {status['version']}, process {status['pid']}, "
        f"up for {status['uptime']:.0f} s",
        *(f"warning: {each}" for each in status["warnings"]),
        *bypass_lines(status["bypasses"]),
        *_losses(status["losses"]),
    ]
    for name, segment in status["segments"].items():
        control = " (control)" if name in status["controlled_from"] else ""
        lines.append(f"segment {name}{control}: {' '.join(segment['endpoints'])}")
        lines += [
            f"  {each['mode'] or 'component'} {each['zid']} {each['name']}".rstrip() for each in segment["components"]
        ]
    lines.append(f"intercepted: {', '.join(status['intercepted']) or 'nothing'}")
    if status.get("services"):
        lines.append(f"intercepted services: {', '.join(status['services'])}")
    lines += [line for each in status["interceptors"] for line in _interceptor(each)]
    lines += _plan(status["plan"])
    lines.append(_recording(status["recording"]))
    lines += ["", *count_table(status["counts"])] if status["counts"] else []
    return [escape_control_chars(line) for line in lines]


def counts_lines(answer: Mapping[str, Any]) -> list[str]:
    """Return the lines of an answer to `counts`: a table by topic, and the losses."""
    return [escape_control_chars(line) for line in [*count_table(answer["counts"]), *_losses(answer["losses"])]]


def answer_lines(answer: Mapping[str, Any]) -> list[str]:
    """Return the lines of an answer to a command that changes something."""
    lines = []
    if "intercepted" in answer:
        lines.append(f"intercepted: {', '.join(answer['intercepted']) or 'nothing'}")
    if "plan" in answer:
        lines += _plan(answer["plan"]) or ["no plan"]
    if "former" in answer and isinstance(answer["former"], str):
        lines.append(f"finished: {answer['former']}")
    if "messages" in answer:
        lines.append(_recording(answer).replace("recording:", "recorded:", 1))
    elif "file" in answer:
        lines.append(f"recording: {answer['file']}")
    return [escape_control_chars(line) for line in lines]


def bypass_lines(bypasses: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the lines about ways around the router, in the form of `status.bypass_rows`."""
    lines = []
    for each in bypasses:
        who = " and ".join(f"{one['name']} ({one['segment'] or 'no segment'})" for one in each["components"])
        state = "is used" if each["active"] else "is open"
        lines += [f"bypass: a way around the router {state}: {who}: {each['evidence']}", f"  hint: {each['cure']}"]
    return lines


def _losses(losses: Mapping[str, Any]) -> list[str]:
    lines = []
    if losses["messages"]:
        reasons = ", ".join(f"{reason}: {number}" for reason, number in losses["reasons"].items())
        lines.append(f"lost: {counted(losses['messages'], 'message')} ({reasons})")
    if losses["recordings"]:
        lines.append(f"lost: {counted(losses['recordings'], 'message')} not recorded")
    return lines + [
        f"lost: segment {each['segment']}: link to {each['peer']} broke ({each['reason']})" for each in losses["links"]
    ]


def _interceptor(each: Mapping[str, Any]) -> list[str]:
    conditions = " ".join(f"{key}={value}" for key, value in each["conditions"].items())
    topics = "" if each["topics"] is None else f"on {', '.join(each['topics'])}"
    lines = [" ".join(filter(None, [f"interceptor {each['name']}", topics, conditions]))]
    if each["bypassed"]:
        lines.append(f"  {each['bypassed']}")
    if each["errors"]:
        lines.append(
            f"  errors: {each['errors']}, last at {each['place'] or 'an unknown place'}; first: {each['error']}"
        )
    return lines


def _plan(plan: Mapping[str, Any] | None) -> list[str]:
    if plan is None:
        return []
    line = (
        f"plan {plan['name']}: {counted(plan['injections'], 'injection')}, carried out {counted(plan['hits'], 'time')}"
    )
    skipped = f", {plan['skipped']} skipped" if plan["skipped"] else ""
    return [line + skipped, *(f"  {topic}: {problem}" for topic, problem in plan["problems"].items())]


def _recording(recording: Mapping[str, Any] | None) -> str:
    if recording is None:
        return "recording: no"
    figures = f"{counted(recording['messages'], 'message')}, {recording['lost']} lost, {recording['seconds']:.0f} s"
    problem = f"; {recording['problem']}" if recording.get("problem") else ""
    return f"recording: {recording['file']} ({figures}){problem}"
