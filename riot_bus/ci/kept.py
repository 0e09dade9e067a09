"""Findings across versions of a system: kept beside its code, and taken over if they fail again."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from riot_bus.campaign.triage import finding_id, severity
from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.base.workspace import NOMINAL, Workspace
from riot_bus.chain.steps.reproduce import Reproduction
from riot_bus.chain.steps.robustness import keep_evidence, put_aside
from riot_bus.findings.records import FindingRecord, MinimalRecord, ProportionRecord, shortest_log
from riot_bus.given_files import given_file
from riot_bus.pool.nominal import needs_baseline
from riot_bus.report.formats import write_file
from riot_bus.report.regression import write_regression_test, write_reproduce
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.trial import TestCase, Violation

LARGEST = 8 << 20
"""Most bytes of a log that is kept in a user's repository."""
_IGNORED = "/trials/\n"


def keep_finding(folder: Path, into: Path) -> Path | None:
    """Copy the files to replay a finding; return its new folder, or None if its log is missing or too large.

    The folder `into` is then like an output folder, without references to the original one. The nominal run is copied
    with a finding that is judged by nominal trials, unless there is one already or it is too large.
    """
    record, log = FindingRecord.load(folder), shortest_log(folder)
    if not log.is_file() or log.stat().st_size > LARGEST:
        return None
    target = into / "findings" / folder.name
    target.mkdir(parents=True, exist_ok=True)
    write_file(_IGNORED, into / ".gitignore")
    for name in (MinimalRecord.FILE, log.name) if MinimalRecord.exists(folder) else (log.name,):
        shutil.copyfile(folder / name, target / name)
    nominal, kept = folder.parent.parent / NOMINAL, into / NOMINAL
    if needs_baseline(record.monitor) and nominal.is_file() and nominal.stat().st_size <= LARGEST and not kept.exists():
        shutil.copyfile(given_file(nominal, inside=nominal.parent), kept)
    write_reproduce(target)
    write_regression_test(target, record)
    system = os.path.relpath(os.path.realpath(record.system_file), target.resolve())
    record.model_copy(update={"system_file": system}).save(target)
    return target


def take_up(
    workspace: Workspace, source: Path, found: Reproduction, *, other: Violation | None = None, evidence: bool
) -> Path:
    """Make a finding for this version of the system from one whose log fails again; return its folder.

    Results from other versions of the code are put aside.

    Args:
        other: Violation of the log, if it fails in another way than before.
        evidence: Whether to repeat it until it leaves evidence.
    """
    record = FindingRecord.load(source)
    name = source.name if other is None else finding_id(other) + ("-system" if record.whole_system else "")
    target, log = workspace.findings / name, source / found.log
    if known := FindingRecord.find(target):
        if known.fingerprint == workspace.fingerprint:
            return target
        aside = put_aside(target, known.fingerprint or "unknown")
        log = aside / found.log if target.resolve() == source.resolve() else log
    target.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(log, target / "failure.mcap")
    failing = FailingLog.load(target / "failure.mcap", registry=workspace.context.registry)
    failed = found.trials if other else found.failed
    changes: dict[str, object] = {
        "id": name,
        "system_file": str(workspace.context.file.path),
        "fingerprint": workspace.fingerprint,
        "rate": ProportionRecord.of(proportion(failed, found.trials)),
        "nominal": None,
        "occurrences": failed,
        "details": (found.detail,) if found.detail else (),
        "delivered": (),
        "messages": len(failing.messages),
        "modified": len(failing.originals),
        "seed": workspace.seed,
        "trials": found.trials,
        "fixed_in": "",
    }
    if other is not None:
        shown = {"component": other.component, "monitor": other.monitor, "signature": other.signature}
        changes |= shown | {"severity": severity(other), "details": (other.detail,) if other.detail else ()}
    record = record.model_copy(update=changes)
    workspace.write_finding(target, record)
    if evidence and not record.whole_system:
        case = TestCase(failing.messages, seed=workspace.seed, ordered=record.ordered)
        keep_evidence(workspace, record, case, target)
    workspace.tell_finding("reproduce", target, record)
    return target
