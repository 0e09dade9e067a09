"""`riot ci change` and `riot ci batch`: test all units for a share of the time and compare with the baseline."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from riot_bus.chain.base.workspace import NOMINAL, Workspace
from riot_bus.chain.steps.reproduce import Answer, Reproduction, play_again
from riot_bus.chain.steps.robustness import test_unit
from riot_bus.ci.kept import take_up
from riot_bus.events import CampaignStarted, FindingReplayed, StepStopped
from riot_bus.findings.known import KnownFinding, KnownFindings, fingerprint_of, title_of
from riot_bus.findings.records import FindingRecord
from riot_bus.findings.steps import STEPS
from riot_bus.given_files import leads_out
from riot_bus.report.campaign_view import CampaignView, load_campaign
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean
from riot_bus.system.system_file import read_system
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError, MissingExtraError


@dataclass(frozen=True, slots=True)
class UnitResult:
    """Result of `riot ci change` or `riot ci batch` for one unit.

    Attributes:
        undecided: Reasons why the result is inconclusive, a text each: earlier findings whose replays do not decide
            whether they still fail, and replays or trials for which there was no time.
    """

    unit: str
    view: CampaignView
    undecided: tuple[str, ...] = ()
    untested: str = ""

    @property
    def doubts(self) -> list[str]:
        """Why a test without findings would be inconclusive."""
        return [*self.undecided, *self.view.doubts]

    def lines(self) -> list[str]:
        """Return the result for people."""
        found = [f"{self.unit}: {self.view.verdict}"]
        for one in sorted(self.view.current, key=lambda one: self.view.standing(one) == "known"):
            standing, entry, rate = self.view.standing(one), self.view.entry(one), one.finding.rate
            often = f" ({rate.count} of {counted(rate.total, 'fresh trial')})" if rate else ""
            found.append(f"  {standing}: {title_of(one.finding)}{often}{f', {entry.told}' if entry else ''}")
            found += [f"    {one.command('reproduce')}"] if standing != "known" else []
        found += [f"  {remark}" for remark in self.view.remarks]
        return [clean(line, limit=1000) for line in found]

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        findings = [
            {
                "folder": str(one.directory),
                "title": title_of(one.finding),
                "fingerprint": fingerprint_of(one.finding),
                "standing": self.view.standing(one),
            }
            for one in self.view.current
        ]
        told = {"verdict": self.view.verdict, "remarks": list(self.view.remarks), "doubts": self.doubts}
        return {"unit": self.unit, "untested": self.untested, **told, "findings": findings}


@dataclass(frozen=True, slots=True)
class CiResult:
    """Results of all units."""

    units: tuple[UnitResult, ...]

    @property
    def failures(self) -> list[FindingView]:
        """The findings that count: those not in the baseline, or marked as fixed there."""
        return [one for unit in self.units for one in unit.view.failures]

    def exit_code(self, *, strict: bool) -> int:
        """Return 1 if findings count; if strict, the code for units not tested or not decided; else 0."""
        if self.failures:
            return 1
        untested = any(unit.untested for unit in self.units)
        doubtful = any(unit.doubts for unit in self.units)
        if not strict or not (untested or doubtful):
            return 0
        return EnvironmentFaultError.exit_code if untested else InconclusiveError.exit_code

    def warnings(self) -> list[str]:
        """Return what was not tested, or not decided, for people."""
        found = [f"not tested: {unit.unit}: {unit.untested}" for unit in self.units if unit.untested]
        doubts = [(unit, each) for unit in self.units if not unit.untested for each in unit.doubts]
        return found + [f"inconclusive: {unit.unit}: {each}" for unit, each in doubts]

    def lines(self) -> list[str]:
        """Return all of it for people."""
        count = len(self.failures)
        last = f"{counted(count, 'finding')} that the baseline does not know" if count else "no new finding"
        untested = sum(bool(unit.untested) for unit in self.units)
        last += f"; {untested} of {counted(len(self.units), 'unit')} not tested" if untested else ""
        return [*(line for unit in self.units for line in unit.lines()), last]


Opened = Callable[[str, Path], AbstractContextManager["Workspace"]]
"""Function that opens a unit's workspace in its folder."""

_UNIT_STEPS = tuple(step for step in STEPS[1:] if not step.whole_system)
_TAKEN = {"findings", "trials"}


@dataclass(frozen=True, slots=True)
class CiPlan:
    """How all units are tested."""

    minutes: float
    stop_early: bool
    explain: bool
    trials: int | None = None


def run_ci(
    units: Sequence[str],
    opened: Opened,
    *,
    out: Path,
    known: KnownFindings,
    plan: CiPlan,
    now: Callable[[], float] = time.monotonic,
) -> CiResult:
    """Test units one after the other, each in a folder of its own, for equal shares of the remaining time.

    Raises:
        ConfigError: A file that people wrote cannot be used; a failing environment is a result, no error.
    """
    deadline, results = now() + plan.minutes * 60, list[UnitResult]()
    for number, unit in enumerate(units):
        begin = now()
        until = begin + max(0.0, deadline - begin) / (len(units) - number)
        results.append(_UnitRun(unit, unit_folder(out, unit), known, plan, (begin, until), now).run(opened))
    return CiResult(tuple(results))


def short(text: str) -> str:
    """Return a title, or why something is so, in the length of a line."""
    return clean(text, limit=300)


def units_of(system: Path, names: Sequence[str]) -> list[str]:
    """Return the units to test: the named ones, or all.

    Raises:
        ConfigError: There is no unit, or none of a given name.
    """
    file = read_system(system)
    return [file.choose_unit(name) for name in names] or list(file.unit) or [file.choose_unit(None)]


def unit_folder(out: Path, unit: str) -> Path:
    """Return the output folder of a unit, inside that of all."""
    name = re.sub(r"[^\w.-]", "_", unit)
    if name != unit or name[:1] in ("", ".") or name in _TAKEN:
        name = f"{name.strip('.') or 'unit'}-{hashlib.sha256(unit.encode()).hexdigest()[:6]}"
    return out / name


def log_of(entry: KnownFinding, known: KnownFindings, findings: Path) -> Path | None:
    """Return a folder with the log of a known finding: the kept one, else one of an earlier run, or None."""
    if (kept := known.folder_of(entry)) is not None:
        return kept
    return next((path for path, record in _recorded(findings) if fingerprint_of(record) == entry.fingerprint), None)


def _recorded(findings: Path) -> list[tuple[Path, FindingRecord]]:
    """Return the findings of an output folder, without those that cannot be used."""
    found = []
    for folder in FindingRecord.folders(findings):
        with suppress(ConfigError):
            found.append((folder, FindingRecord.load(folder)))
    return found


def _tidy(workspace: Workspace) -> None:
    """Delete trials of other code and old versions of findings, so that an output folder stays small."""
    workspace.store.keep_only(json.dumps({"system": workspace.fingerprint})[1:-1])
    for folder in workspace.findings.glob("*/earlier"):
        if leads_out(folder, workspace.findings):
            continue
        aside = [path for path in folder.iterdir() if path.is_dir() and not path.is_symlink()]
        aside.sort(key=lambda path: path.stat().st_mtime)
        for path in aside[:-3]:
            shutil.rmtree(path)


def answer_of(workspace: Workspace, folder: Path) -> tuple[Answer, Reproduction | None, str]:
    """Replay the log of a finding; return the answer, the trials behind it, and a short text about them."""
    unit = FindingRecord.load(folder).unit
    if unit not in workspace.context.file.unit:
        return "not decided", None, f"riot.toml has no unit {clean(unit)!r}"
    try:
        found = play_again(workspace, folder)
    except InconclusiveError as error:
        return "not decided", None, error.message
    others = f", fails as {', '.join(each.signature for each in found.others)}" if found.others else ""
    return found.answer, found, f"{found.failed} of {counted(found.trials, 'fresh trial')} failed so{others}"


@dataclass(slots=True)
class _UnitRun:
    """The test of one unit."""

    unit: str
    folder: Path
    known: KnownFindings
    plan: CiPlan
    time: tuple[float, float]
    now: Callable[[], float]
    fingerprint: str = ""
    ended: bool = False
    counting: str = ""
    remarks: list[str] = field(default_factory=list)
    undecided: list[str] = field(default_factory=list)

    def run(self, opened: Opened) -> UnitResult:
        """Test the unit; a failing environment is a result."""
        untested = ""
        try:
            with opened(self.unit, self.folder) as workspace:
                self._test(workspace)
        except EnvironmentFaultError as error:
            untested = str(error)
        view = CampaignView(self.folder, None, (), unit=self.unit)
        if self.fingerprint:
            of_it = {"unit": self.unit, "fingerprint": self.fingerprint}
            view = load_campaign(self.folder, finished=self.ended, **of_it)
        problem = untested.partition("\n")[0]
        view = replace(view, known=self.known.entries, problem=problem, excused=bool(problem))
        view = replace(view, remarks=tuple(self.remarks))
        return UnitResult(self.unit, view, tuple(self.undecided), untested)

    def _test(self, workspace: Workspace) -> None:
        self.fingerprint = workspace.fingerprint
        _tidy(workspace)
        workspace.tell(CampaignStarted(self.unit, self.fingerprint))
        self._share_nominal(workspace)
        log = workspace.unit_log(self.unit)
        workspace.runners.baseline(self.unit, lambda: log)  # otherwise it would take time of the campaign
        self._play_known(workspace)
        begin, until = self.time
        end = begin + (until - begin) * 0.7 if self.plan.explain else until
        reason = "the time was over before" if self.now() >= end else ""
        self.undecided += ["no injected trial: the time was over before"] if reason else []
        seconds = max(end - self.now(), 0.1)
        test_unit(
            workspace,
            self.unit,
            trials=self.plan.trials,
            seconds=seconds,
            covered=False,
            stop=lambda folders: reason or self._enough(folders),
        )
        self.ended = True
        if self.plan.explain:
            self._explain(workspace)

    def _share_nominal(self, workspace: Workspace) -> None:
        """Take the recording in another unit's folder, by a hard link or a copy, if one is needed and missing here."""
        file, own = workspace.context.file, self.folder / NOMINAL
        if file.system.nominal or file.unit[self.unit].log or own.exists():
            return
        if other := next(iter(sorted(self.folder.parent.glob(f"*/{NOMINAL}"))), None):
            own.unlink(missing_ok=True)  # a link to nothing
            try:
                own.hardlink_to(other)
            except OSError:  # a file system without hard links
                shutil.copyfile(other, own)

    def _play_known(self, workspace: Workspace) -> None:
        """Replay earlier findings: first fixed ones, then those not in the baseline, then those known to fail."""
        entries = self.known.of(self.unit)
        known = [(log_of(one, self.known, workspace.findings), one) for one in entries]
        others = [
            (folder, None)
            for folder, record in _recorded(workspace.findings)
            if record.fingerprint != self.fingerprint and fingerprint_of(record) not in self.known.entries
        ]
        begin, until = self.time
        left = self._play_all(workspace, [*(each for each in known if each[1].fixed), *others], until)
        if left:
            self.undecided.append(f"there was no time to play {counted(left, 'earlier finding')} again")
        self._play_all(workspace, [each for each in known if not each[1].fixed], begin + (until - begin) * 0.5)

    def _play_all(
        self, workspace: Workspace, some: Sequence[tuple[Path | None, KnownFinding | None]], end: float
    ) -> int:
        """Replay findings that have a log while there is time; return the number of those left out."""
        logs = [(folder, entry) for folder, entry in some if folder is not None]
        for number, (folder, entry) in enumerate(logs):
            if self.now() >= end:
                return len(logs) - number
            self._play(workspace, folder, entry)
        return 0

    def _play(self, workspace: Workspace, folder: Path, entry: KnownFinding | None) -> None:
        record = FindingRecord.load(folder)
        if record.fingerprint == self.fingerprint and folder.parent == workspace.findings:
            return  # found with this same code
        title = short(title_of(record))
        with workspace.step("reproduce") as step:
            answer, found, why = answer_of(workspace, folder)
            is_open = entry is not None and not entry.fixed
            said = f"was fixed {entry.fixed}" if entry and entry.fixed else "known" if entry else "found earlier"
            if found is not None and answer == "still failing":
                take_up(workspace, folder, found, evidence=not is_open)
                self.counting = self.counting or ("" if is_open else title)
            elif found is not None and answer == "failing otherwise":
                (other,) = found.others
                made = take_up(workspace, folder, found, other=other, evidence=True)
                self.counting = self.counting or (title if self._counts(made) else "")
            elif answer == "not decided" and not is_open:
                self.undecided.append(f"{title} ({said}): {why}")
            step.end(f"{answer}: {title} ({why})")
        hint = "; `riot ci prune --update` marks it as fixed" if answer == "fixed" and is_open else ""
        quiet = answer == "still failing" or (answer == "fixed" and self._was_fixed(workspace, folder, entry))
        text = "" if quiet else f"{answer} ({said}): {title}: {short(why)}{hint}"
        self.remarks += [text] if text else []
        failed, trials = (found.failed, found.trials) if found else (0, 0)
        workspace.tell(FindingReplayed(str(folder), title, answer, text, failed, trials))

    def _was_fixed(self, workspace: Workspace, folder: Path, entry: KnownFinding | None) -> bool:
        """Record in the output folder that a finding is fixed; return whether that was known."""
        path, before = workspace.findings / folder.name, bool(entry and entry.fixed)
        if record := FindingRecord.find(path):
            before = before or (entry is None and bool(record.fixed_in))
            record.model_copy(update={"fixed_in": self.fingerprint}).save(path)
        return before

    def _counts(self, folder: Path) -> bool:
        entry = self.known.entries.get(fingerprint_of(FindingRecord.load(folder)))
        return entry is None or bool(entry.fixed)

    def _enough(self, folders: Sequence[Path]) -> str:
        """Return why the campaign ends; empty if it continues."""
        if not self.plan.stop_early:
            return ""
        if self.counting:
            return f"the log of an earlier finding fails: {self.counting}"
        return "a new finding is enough" if any(map(self._counts, folders)) else ""

    def _explain(self, workspace: Workspace) -> None:
        """Take findings through the steps on the unit while there is time, in each step those that count first."""
        ended = set[Path]()
        for step in _UNIT_STEPS:
            view = load_campaign(self.folder)
            view = replace(view, known=self.known.entries)
            for one in sorted(view.current, key=lambda one: view.standing(one) == "known"):
                folder = one.directory
                if one.finding.whole_system or folder in ended or step.kind.exists(folder):
                    continue
                if self.now() >= self.time[1]:
                    self.remarks.append("not all findings are explained: the time was over; each step goes on by hand")
                    return
                try:
                    workspace.carry_out(step, folder)
                except InconclusiveError as error:
                    ended.add(folder)
                    workspace.tell(StepStopped(step.name, str(error), str(folder)))
                except MissingExtraError as error:
                    self.remarks.append(f"findings are not explained by `riot {step.name}`: {error.message}")
                    return
