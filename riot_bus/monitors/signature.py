"""Signatures: what makes two crashes the same crash.

A crash is identified by its place, not by its words, so that one defect that raises different exceptions for different
inputs stays one finding. And the place is not a line number or a file, which change with every edit: of a Python
traceback it is the innermost function of the component's own code and the text of the line in it. A native crash has
its signal, and the functions of Python around it, where `faulthandler` tells them.
"""

from __future__ import annotations

import re
import signal
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

__all__ = ["Crash", "crashes_in", "tracebacks"]

_FRAME = re.compile(
    r'^\s*File "(?P<file>[^"]+)", line (?P<line>\d+),? in (?P<function>.+)\n?(?P<source>    .*)?$', re.MULTILINE
)
_MARK = "Traceback (most recent call last):"
_CHAINED = re.compile(r"^(During handling of the above|The above exception was the direct)", re.MULTILINE)
_FATAL = re.compile(r"^Fatal Python error: .*$", re.MULTILINE)
_CURRENT = "Current thread "
_TERMINATE = re.compile(r"terminate called after throwing an instance of '([^']+)'")
_RUST = re.compile(r"panicked at ([^:\n]+):\d+")
_SUMMARY = re.compile(r"^SUMMARY: (?P<tool>\w+Sanitizer): (?P<kind>[\w-]+)(?:.* in (?P<function>\S+))?", re.MULTILINE)
_UNDEFINED = re.compile(r"^(?P<file>\S+?):\d+:\d+: runtime error: (?P<text>.+)$", re.MULTILINE)
_NUMBER = re.compile(r"(?<![A-Za-z])[-+]?(?:0x[0-9a-fA-F]+|\d[\d.e+-]*)")
_AFTERWORDS = 4
_LONGEST_SOURCE = 100
_LONGEST_DETAIL = 500
_MOST = 16
_CALLERS = 3


@dataclass(frozen=True, slots=True)
class Crash:
    """Where a component crashed, and its last words."""

    place: str
    detail: str


def tracebacks(text: str) -> list[str]:
    """Return the Python tracebacks in a text, each with its exception line; of chained exceptions, the last one."""
    found = []
    starts = [match.start() for match in re.finditer(re.escape(_MARK), text)]
    for start, following in pairwise([*starts, len(text)]):
        part = text[start:following]
        lines = part.splitlines()
        end = next((n for n, line in enumerate(lines[1:], 1) if line and not line.startswith((" ", "\t"))), len(lines))
        if following == len(text) or not _CHAINED.search("\n".join(lines[end + 1 :])):
            found.append("\n".join(lines[: end + 1]))
    return found


def crashes_in(status: int | None, errors: str, root: Path, printed: str = "") -> tuple[Crash, ...]:
    """Return where a component crashed, each place once; what ended the process comes first.

    Args:
        status: Exit status, negative for a signal, None if the process still lives.
        errors: Its stderr.
        root: Folder of its code.
        printed: Its stdout, where some programs write their tracebacks.

    Returns:
        Nothing when neither the status nor what it wrote speaks of a crash.
    """
    known = [*tracebacks(printed), *tracebacks(errors)][-_MOST:]
    python = [Crash(_place(each, root), _detail(each, root)) for each in reversed(known)]
    if status == 0:
        python = []  # what it wrote did not keep it from a good end
    # A Python process with native threads may abort while it ends of an exception: the exception is the crash.
    last = known[-1] if known else ""
    ending = bool(last) and len(errors.rpartition(last)[2].splitlines()) <= _AFTERWORDS
    reports = _sanitizer_reports(errors)
    found = [*reports, *python]
    if status is not None and status < 0 and not ending and not reports:
        found = [_native(status, errors, root), *python]
    elif status is not None and status > 0 and not found:
        found = [Crash(f"exit status {status}", _last_line(errors))]
    return tuple({crash.place: crash for crash in reversed(found)}.values())[::-1]


def _sanitizer_reports(errors: str) -> list[Crash]:
    """Return what the sanitizers of compilers have reported; undefined behaviour does not end a process."""
    found = []
    for match in islice(_SUMMARY.finditer(errors), _MOST):
        where = f" in {match['function']}" if match["function"] else ""
        kind = _NUMBER.sub("N", match["kind"])
        found.append(Crash(f"{match['tool']} {kind}{where}", match[0][:_LONGEST_DETAIL]))
    for match in islice(_UNDEFINED.finditer(errors), _MOST):
        what = _NUMBER.sub("N", match["text"])[:_LONGEST_SOURCE]
        found.append(Crash(f"{Path(match['file']).name}: runtime error: {what}", match[0][:_LONGEST_DETAIL]))
    return found


def _place(traceback: str, root: Path) -> str:
    frames = list(_FRAME.finditer(traceback))
    if not frames:
        return "unknown place"
    frame = next((each for each in reversed(frames) if _is_own(each["file"], root)), frames[-1])
    source = " ".join((frame["source"] or "").split())[:_LONGEST_SOURCE]
    return f"{frame['function']}: {source}" if source else f"{frame['function']} of {Path(frame['file']).name}"


def _detail(traceback: str, root: Path) -> str:
    frame = next((each for each in reversed(list(_FRAME.finditer(traceback))) if _is_own(each["file"], root)), None)
    where = f" ({Path(frame['file']).name}:{frame['line']})" if frame else ""
    return traceback.splitlines()[-1][:_LONGEST_DETAIL] + where


def _is_own(file: str, root: Path) -> bool:
    return Path(file).is_relative_to(root) and "site-packages" not in Path(file).parts


def _native(status: int, errors: str, root: Path) -> Crash:
    name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
    for pattern in (_TERMINATE, _RUST):
        if match := pattern.search(errors):
            return Crash(f"{name} {match[1]}", _last_line(errors))
    fatal = _FATAL.search(errors)
    if fatal is None:
        return Crash(name, _last_line(errors))
    thread = errors[fatal.end() :].partition(_CURRENT)[2].partition("\n\n")[0]
    functions = [each["function"] for each in _FRAME.finditer(thread) if _is_own(each["file"], root)][:_CALLERS]
    return Crash(f"{name} in {' < '.join(functions)}" if functions else name, fatal[0])


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:_LONGEST_DETAIL] if lines else ""
