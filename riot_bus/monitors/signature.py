"""Signatures: what makes two crashes the same crash.

A crash is identified by its place, not by its words: the innermost frame of the component's own code for a Python
traceback, the signal (and the C++ exception type, where the runtime prints it) otherwise. So one defect that raises
different exceptions for different inputs stays one finding.
"""

from __future__ import annotations

import re
import signal
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Crash", "crash_in", "last_traceback"]

_FRAME = re.compile(r'^\s*File "(?P<file>[^"]+)", line (?P<line>\d+), in (?P<function>.+)$', re.MULTILINE)
_MARK = "Traceback (most recent call last):"
_TERMINATE = re.compile(r"terminate called after throwing an instance of '([^']+)'")
_AFTERWORDS = 4
_RUST = re.compile(r"panicked at ([^:\n]+:\d+)")


@dataclass(frozen=True, slots=True)
class Crash:
    """Where a component crashed, and its last words."""

    place: str
    detail: str


def last_traceback(text: str) -> str | None:
    """Return the last complete Python traceback in `text`, with its exception line; None if there is none."""
    start = text.rfind(_MARK)
    if start < 0:
        return None
    lines = text[start:].splitlines()
    end = next(
        (number for number, line in enumerate(lines[1:], 1) if line and not line.startswith((" ", "\t"))), len(lines)
    )
    return "\n".join(lines[: end + 1])


def _own_frame(traceback: str, root: Path) -> str | None:
    frames = list(_FRAME.finditer(traceback))
    for frame in reversed(frames):
        file = Path(frame["file"])
        if file.is_relative_to(root) and "site-packages" not in file.parts:
            return f"{file.relative_to(root)}:{frame['line']} in {frame['function']}"
    if not frames:
        return None
    return f"{Path(frames[-1]['file']).name}:{frames[-1]['line']} in {frames[-1]['function']}"


def crash_in(status: int | None, errors: str, root: Path) -> Crash | None:
    """Return where a component crashed.

    Args:
        status: Exit status, negative for a signal, None if the process still lives.
        errors: Its stderr.
        root: Folder of its code.

    Returns:
        None when neither the status nor stderr speaks of a crash.
    """
    traceback = last_traceback(errors)
    # A Python process with native threads may abort while it ends of an exception: the exception is the crash.
    ending = traceback is not None and len(errors.rpartition(traceback)[2].splitlines()) <= _AFTERWORDS
    if status is None or status > 0 or (status < 0 and ending):
        if traceback is not None:
            place = _own_frame(traceback, root)
            return Crash(place or "unknown place", traceback.splitlines()[-1][:500])
        if status is None:
            return None
        return Crash(f"exit status {status}", _last_line(errors))
    if status == 0:
        return None
    name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
    for pattern in (_TERMINATE, _RUST):
        match = pattern.search(errors)
        if match:
            return Crash(f"{name} {match[1]}", _last_line(errors))
    return Crash(name, _last_line(errors))


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:500] if lines else ""
