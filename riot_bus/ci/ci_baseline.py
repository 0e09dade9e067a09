"""Changing the baseline: findings that become known, and known ones that are fixed."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from riot_bus.ci.ci import Opened, answer_of, log_of, short, unit_folder
from riot_bus.ci.kept import LARGEST, keep_finding
from riot_bus.events import FindingReplayed
from riot_bus.findings.known import KnownFinding, KnownFindings, fingerprint_of
from riot_bus.findings.records import FindingRecord
from riot_bus.report.campaign_view import is_output_folder, load_campaign
from riot_bus.report.format import clean
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError


def moment(folder: Path, *, environment: Mapping[str, str] = os.environ) -> str:
    """Return the current date, and the commit of the repository that contains a folder, if there is one."""
    commit = next((environment[name] for name in ("GITHUB_SHA", "CI_COMMIT_SHA") if environment.get(name)), "")
    git = shutil.which("git")
    if not commit and git:
        line = [git, "-C", str(folder), "rev-parse", "HEAD"]
        with suppress(subprocess.SubprocessError):
            commit = subprocess.run(line, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    return " ".join([datetime.now(UTC).date().isoformat(), *([clean(commit[:12])] if commit else [])])


def found_in(paths: Iterable[Path]) -> list[Path]:
    """Return the folders of findings: the given ones, and those of the tested code in given output folders.

    Raises:
        ConfigError: One of the paths has no finding.
    """
    found = list[Path]()
    for path in paths:
        here = [path] if FindingRecord.exists(path) else _current(path)
        if not here:
            raise ConfigError(f"no finding at {str(path)!r}", hint="name the folder of a finding, or an output folder")
        found += here
    return found


def _current(path: Path) -> list[Path]:
    outs = [path] if is_output_folder(path) else [one for one in sorted(path.glob("*")) if is_output_folder(one)]
    return [one.directory for out in outs for one in load_campaign(out).current]


def check_keep(known: KnownFindings, keep: Path | None) -> None:
    """Raise ConfigError if findings are to be kept where the baseline cannot name them."""
    if keep is not None and not keep.resolve().is_relative_to(known.path.parent.resolve()):
        hint = f"the baseline is {known.path}: its entries say where logs are from there"
        raise ConfigError("findings are kept in the folder of the baseline, or below", where=str(keep), hint=hint)


def accept(
    known: KnownFindings,
    folders: Iterable[Path],
    *,
    since: str,
    note: str | None = None,
    keep: Path | None = None,
    reopen: bool = True,
) -> tuple[KnownFindings, list[str]]:
    """Return a baseline with findings added, and lines on what has changed; entries keep what people wrote.

    Args:
        keep: Folder, beside or below the baseline, for the files to replay the findings; None for none.
        reopen: Whether entries that are marked as fixed lose this mark.

    Raises:
        ConfigError: A finding cannot be used, or `keep` lies elsewhere.
    """
    check_keep(known, keep)
    changed, lines = list[KnownFinding](), list[str]()
    for folder in folders:
        record = FindingRecord.load(folder)
        before = known.entries.get(fingerprint_of(record))
        entry = before or KnownFinding.of(record, since=since)
        if before and before.fixed and not reopen:
            continue
        told = [] if before else ["added"]
        if before and before.fixed:
            told.append(f"no longer fixed {before.fixed}")
            entry = entry.model_copy(update={"fixed": ""})
        if note is not None and note != entry.note:
            told.append("note")
            entry = entry.model_copy(update={"note": note})
        if keep is not None and known.folder_of(entry) is None:
            kept = keep_finding(folder, keep)
            told.append(f"kept in {kept}" if kept else f"not kept: no log of at most {LARGEST >> 20} MiB")
            log = os.path.relpath(kept.resolve(), known.path.parent.resolve()) if kept else ""
            entry = entry.model_copy(update={"log": log})
        if entry != before:
            changed.append(entry)
            lines.append(f"{', '.join(told)}: {short(entry.title)}")
    return known.updated(changed), lines


@dataclass(frozen=True, slots=True)
class PrunedFinding:
    """A finding of the baseline, and the result of its replay.

    Attributes:
        answer: Answer as in `chain.steps.reproduce.Reproduction`, or `cannot be run`.
        back: Whether it was marked as fixed and fails again.
    """

    unit: str
    title: str
    answer: str
    text: str
    back: bool = False


@dataclass(frozen=True, slots=True)
class PruneResult:
    """Results of the replays of findings of the baseline, and the updated baseline."""

    asked: tuple[PrunedFinding, ...]
    known: KnownFindings
    left_out: tuple[str, ...] = ()

    def exit_code(self, *, strict: bool) -> int:
        """Return 1 if a fixed finding fails again; if strict, the code for one not run or not decided; else 0."""
        answers = {one.answer for one in self.asked}
        if any(one.back for one in self.asked):
            return 1
        if strict and "cannot be run" in answers:
            return EnvironmentFaultError.exit_code
        return InconclusiveError.exit_code if strict and "not decided" in answers else 0

    def lines(self) -> list[str]:
        """Return the results for people."""
        found = [
            f"{'failing again' if one.back else one.answer}: {one.unit}: {one.title} ({one.text})" for one in self.asked
        ]
        answers = Counter("failing again" if one.back else one.answer for one in self.asked)
        told = ", ".join(f"{count} {answer}" for answer, count in sorted(answers.items()))
        last = counted(len(self.asked), "known finding") + (f": {told}" if told else "")
        last += f"; those of {', '.join(self.left_out)} were not asked" if self.left_out else ""
        return [clean(line, limit=1000) for line in (*found, last)]

    def to_json(self) -> list[dict[str, Any]]:
        """Return the results as JSON values."""
        return [asdict(one) for one in self.asked]


def prune(units: Sequence[str], opened: Opened, *, out: Path, known: KnownFindings, when: str) -> PruneResult:
    """Replay the log of each known finding to fresh components, and mark findings that no longer fail as fixed.

    Marked findings stay marked, and are still replayed, also by `riot ci change`.
    """
    asked, fixed = list[PrunedFinding](), list[KnownFinding]()
    for unit in units:
        entries = known.of(unit)
        folder = unit_folder(out, unit)
        found = _ask(unit, folder, entries, opened, known) if entries else []
        asked += found
        pairs = zip(entries, found, strict=True)
        fixed += [
            entry.model_copy(update={"fixed": when})
            for entry, one in pairs
            if one.answer == "fixed" and not entry.fixed
        ]
    others = {entry.unit for entry in known.entries.values()} - set(units)
    return PruneResult(tuple(asked), known.updated(fixed), tuple(sorted(others)))


def _ask(
    unit: str, out: Path, entries: Sequence[KnownFinding], opened: Opened, known: KnownFindings
) -> list[PrunedFinding]:
    found = list[PrunedFinding]()
    try:
        with opened(unit, out) as workspace:
            workspace.unit_log(unit)  # some failures are judged by comparison with it
            for entry in entries:
                title = short(entry.title)
                folder = log_of(entry, known, workspace.findings)
                if folder is None:
                    found.append(PrunedFinding(unit, title, "cannot be run", "no log of it is kept"))
                    continue
                with workspace.step("reproduce") as step:
                    answer, made, text = answer_of(workspace, folder)
                    step.end(f"{answer}: {title} ({text})")
                back = bool(entry.fixed) and answer == "still failing"
                found.append(PrunedFinding(unit, title, answer, text, back))
                failed, trials = (made.failed, made.trials) if made else (0, 0)
                workspace.tell(FindingReplayed(str(folder), title, answer, text, failed, trials))
    except EnvironmentFaultError as error:
        rest = entries[len(found) :]
        why = error.message.partition("\n")[0]
        found += [PrunedFinding(unit, short(one.title), "cannot be run", why) for one in rest]
    return found
