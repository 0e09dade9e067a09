"""Place of a finding in a repository: the line of code that fails, else the line where riot.toml names the unit.

It is taken from what a failing trial has printed: Python tracebacks and stacks, sanitizer reports, and native stacks as
debuggers write them. Lines say where a finding is, never which one it is.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from riot_bus.config.toml_file import line_of
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.given_files import given_text
from riot_bus.monitors.signature import SourceFrame, fatal_thread, frames_in, traceback_of
from riot_bus.report.finding_view import FindingView, evidence_files, tail_of
from riot_bus.report.format import clean
from riot_bus.vocabulary.errors import ConfigError

_KINDS = ("stdout", "stderr", "stacks")
_LARGEST = 32 << 20  # twice what is kept of an output: bytes that are no text become three
_FILE = r"(?P<file>[^\s:(),]+\.\w+):(?P<line>\d{1,9})(?::\d+)?"
_NATIVE = (
    re.compile(rf"[ \t]*#\d+ .* {_FILE}$"),  # a frame of a sanitizer or a debugger
    re.compile(rf"{_FILE}: runtime error: "),
    re.compile(rf".* panicked at {_FILE}:?$"),
)
_OTHERS = {"site-packages", "dist-packages"}


@dataclass(frozen=True, slots=True)
class SourcePlace:
    """A line, from 1, of a file: its path from the root of the repository, with `/` between its parts."""

    path: str
    line: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}"


def find_place(view: FindingView) -> SourcePlace:
    """Return the place of a finding: the innermost line of the user's code that failed, else that of the unit."""
    finding = view.finding
    system = _real(finding.system_file)
    root = _root_of(system)
    texts = {kind: _evidence(view.directory, f"{finding.component}.{kind}.txt") for kind in _KINDS}
    texts["backtrace"] = _evidence(view.directory, "backtrace.txt")
    for frame in failing_stack(finding, texts):
        path = _real(str(system.parent / frame.file))
        if _is_own(frame.file, path, root):
            return _place(path, root, frame.line)
    return unit_place(finding)


def failing_stack(finding: FindingRecord, texts: Mapping[str, str]) -> Iterator[SourceFrame]:
    """Yield lines of source on the stack on which a finding fails, the innermost first; nothing where none is known.

    Args:
        texts: Texts that its component left in a failing trial: its `stdout`, its `stderr`, the `stacks` of its
            threads, and the `backtrace` of a debugger.
    """
    errors, stacks = texts.get("stderr", ""), texts.get("stacks", "")
    if finding.monitor == "crash":
        root = Path(finding.system_file).parent
        raised = traceback_of(finding.signature, errors, texts.get("stdout", ""), root)
        yield from reversed(frames_in(raised))
        if not raised:
            yield from _native_frames([*errors.splitlines(), *texts.get("backtrace", "").splitlines()])
            yield from frames_in(fatal_thread(errors))
    elif finding.monitor == "hang":
        stands_in = set(finding.signature.partition(": in ")[2].split(", "))
        yield from (frame for frame in frames_in(stacks) if frame.function in stands_in)


def _native_frames(lines: Iterable[str]) -> Iterator[SourceFrame]:
    for line in lines:
        found = next((match for one in _NATIVE if (match := one.match(line[:2000]))), None)
        if found:
            yield SourceFrame(found["file"], int(found["line"]), "")


def unit_place(record: FindingRecord | CampaignRecord) -> SourcePlace:
    """Return where riot.toml names the unit of a finding or campaign; its first line if the file is gone."""
    system = _real(record.system_file)
    try:
        text = given_text(system)
    except (OSError, ValueError, ConfigError):
        text = ""
    return _place(system, _root_of(system), line_of(text, ["unit", record.unit]))


def _real(path: str) -> Path:
    """Return a path with links resolved, as pages of a repository need; for a missing file, as far as possible."""
    return Path(os.path.realpath(path.replace("\0", "").encode(errors="replace")).decode(errors="replace"))


def _root_of(system: Path) -> Path:
    """Return the root for paths: riot.toml's repository, else the working folder if above it, else its own folder."""
    for folder in system.parents:
        if os.path.exists(folder / ".git"):
            return folder
    here = Path.cwd().resolve()
    return here if system.is_relative_to(here) else system.parent


def _place(path: Path, root: Path, line: int) -> SourcePlace:
    return SourcePlace(clean(path.relative_to(root).as_posix(), limit=1000), line)  # a cut path leads to no file


def _is_own(file: str, path: Path, root: Path) -> bool:
    """Return whether a file of a stack is the user's; one with a relative path has to exist."""
    own = path.is_relative_to(root) and not _OTHERS.intersection(path.parts)
    return own and (os.path.isabs(file) or os.path.isfile(path))


def _evidence(directory: Path, name: str) -> str:
    """Return the end of a file that a failing trial has left; empty if there is none of that name."""
    files = {path.name: path for path in evidence_files(directory) if path.suffix == ".txt"}
    return tail_of(files[name], _LARGEST) if name in files else ""
