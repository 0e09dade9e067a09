"""Signatures of crashes: two crashes with the same signature are the same finding.

A crash is identified by its place, not by its words, so that one defect that raises different exceptions for different
inputs stays one finding. The place is not a file or a line number, which change with every edit. For a Python
traceback, it is the innermost function of the component's own code and the text of its line. For a native crash, it is
the signal and the innermost native functions of the component's own files, then the Python functions around them, where
`faulthandler` reports them.
"""

from __future__ import annotations

import re
import signal
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

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
_SYSTEM = re.compile(
    r"/(ld-linux[\w-]*|libc|libm|libstdc\+\+|libgcc_s|libpthread|libdl|librt)(-[\d.]+)?\.so[\d.]*$"
    r"|/(lib)?python\d[\w.]*$|^\[|^$"
)
_LIBRARIES = re.compile(r"^/(usr/(?!local/)|lib\d*/|opt/ros/)|/lib(64)?/python\d|/(site|dist)-packages/")
_STANDARD = re.compile(r"^_Z(N?K?St|NK?9__gnu_cxx)")
"""Functions of the C++ standard library, which are found in the files that use them."""
_LAUNCHED = re.compile(r"^\[[^\[\]\n]{1,200}-\d+\] ", re.MULTILINE)
"""Prefix that ROS launch adds to each line of a process that it has started."""
_DIED = re.compile(
    r"^\[ERROR\] \[(?P<name>[^\[\]\n]{1,200})-\d+\]: process has died \[pid \d+, exit code (?P<status>-?\d+)",
    re.MULTILINE,
)
_AFTERWORDS = 4  # lines: `terminate` adds about two; after more, the program had gone on
_LONGEST_SOURCE = 100  # it is part of the signature, which is shown in one line
_LONGEST_DETAIL = 500  # an exception may quote a whole payload
_MOST = 16  # a program that goes on after errors may write any number of tracebacks
_CALLERS = 3  # with more, one defect that is reached in several ways would be several findings


@dataclass(frozen=True, slots=True)
class Crash:
    """Place at which a component crashed, and its last message."""

    place: str
    detail: str


class SourceFrame(NamedTuple):
    """A line of source on a Python stack."""

    file: str
    line: int
    function: str


def frames_in(text: str) -> list[SourceFrame]:
    """Return the frames of Python stacks in the order of a text; tracebacks end with the innermost one."""
    return [SourceFrame(each["file"], int(each["line"]), each["function"]) for each in _FRAME.finditer(text)]


def traceback_of(signature: str, errors: str, printed: str, root: Path) -> str:
    """Return the last Python traceback of a crash with this signature; empty if there is none.

    The signature ends with the place of the crash; the component recovered from errors at other places.
    """
    known = (each for text in (errors, printed) for each in reversed(tracebacks(_LAUNCHED.sub("", text))))
    return next((each for each in known if signature.endswith(_place(each, root))), "")


def fatal_thread(errors: str) -> str:
    """Return the stack that `faulthandler` wrote for the thread that received a signal; empty if there is none."""
    fatal = _FATAL.search(errors)
    return errors[fatal.end() :].partition(_CURRENT)[2].partition("\n\n")[0] if fatal else ""


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


def crashes_in(
    status: int | None, errors: str, root: Path, printed: str = "", *, stack: Sequence[tuple[str, str]] = ()
) -> tuple[Crash, ...]:
    """Return where a component crashed, each place once; what ended the process comes first.

    The status is negative for a signal, None if the process still lives; then only the output tells. Some programs
    write tracebacks to stdout. The stack has file and function of each native frame at the signal that ended it,
    innermost first; a function without a name is written as `+` and its offset in the file.
    """
    died = [match for text in (printed, errors) for match in _DIED.finditer(text)][:_MOST]
    printed, errors = (_LAUNCHED.sub("", text) for text in (printed, errors))
    known = [*tracebacks(printed), *tracebacks(errors)]
    latest = dict.fromkeys(reversed(known))
    python = _one_of_each(Crash(_place(each, root), _detail(each, root)) for each in latest)
    if status == 0:
        python, died = [], []  # despite what it wrote, it ended well
    # A Python process with native threads may abort while an exception ends it: the exception is the crash.
    last = known[-1] if known else ""
    ending = bool(last) and len(errors.rpartition(last)[2].splitlines()) <= _AFTERWORDS
    reports = _sanitizer_reports(errors)
    found = [*reports, *python] or [Crash(f"{_told(int(one['status']))} of {one['name']}", one[0]) for one in died]
    if status is not None and status < 0 and not ending and not reports:
        found = [_native(status, errors, root, stack), *python]
    elif status is not None and status > 0 and not found:
        found = [Crash(_told(status), _last_line(errors))]
    return tuple({crash.place: crash for crash in reversed(found)}.values())[::-1]


def _sanitizer_reports(errors: str) -> list[Crash]:
    """Return what the sanitizers of compilers have reported; undefined behaviour does not end a process."""
    summaries = (
        Crash(f"{each['tool']} {_NUMBER.sub('N', each['kind'])}{where}", each[0][:_LONGEST_DETAIL])
        for each in _SUMMARY.finditer(errors)
        for where in (f" in {each['function']}" if each["function"] else "",)
    )
    undefined = (
        Crash(f"{Path(each['file']).name}: runtime error: {what}", each[0][:_LONGEST_DETAIL])
        for each in _UNDEFINED.finditer(errors)
        for what in (_NUMBER.sub("N", each["text"])[:_LONGEST_SOURCE],)
    )
    return [*_one_of_each(summaries), *_one_of_each(undefined)]


def _one_of_each(crashes: Iterable[Crash]) -> list[Crash]:
    """Return the first crash of each place, of a bounded number of places."""
    found: dict[str, Crash] = {}
    for crash in crashes:
        found.setdefault(crash.place, crash)
        if len(found) == _MOST:
            break
    return list(found.values())


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


def _told(status: int) -> str:
    """Return the name of an exit status, which is negative for a signal."""
    if status >= 0:
        return f"exit status {status}"
    return signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"


def _native(status: int, errors: str, root: Path, stack: Sequence[tuple[str, str]]) -> Crash:
    place = _told(status)
    thrown = next((match for pattern in (_TERMINATE, _RUST) if (match := pattern.search(errors))), None)
    fatal = _FATAL.search(errors)
    thread = "" if thrown else fatal_thread(errors)
    python = [each["function"] for each in _FRAME.finditer(thread) if _is_own(each["file"], root)]
    functions = [*_native_functions(stack, own=bool(python)), *python][:_CALLERS]
    place += f" {thrown[1]}" if thrown else ""
    place += f" in {' < '.join(functions)}" if functions else ""
    return Crash(place, fatal[0] if fatal and not thrown else _last_line(errors))


def _native_functions(stack: Sequence[tuple[str, str]], *, own: bool) -> list[str]:
    """Return the functions of the component's own files; if there are none and `own` is False, those of others."""
    system = [frame for frame in stack if not _SYSTEM.search(frame[0])]
    mine = [frame for frame in system if not _LIBRARIES.search(frame[0])]
    frames = mine or ([] if own else system or stack)
    frames = [frame for frame in frames if not _STANDARD.search(frame[1])] or frames
    names = [f"{Path(file).name}{function}" if function[:1] in ("+", "") else function for file, function in frames]
    return [name for name, _ in groupby(names)]


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:_LONGEST_DETAIL] if lines else ""
