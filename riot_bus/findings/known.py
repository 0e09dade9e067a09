"""The baseline: known findings, in a file of the repository that people read, merge and annotate.

A finding is identified by component and title, which contain no line numbers, so it stays known when lines shift.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from riot_bus.findings.records import FindingRecord
from riot_bus.given_files import given_text, leads_out
from riot_bus.new_file import write_whole
from riot_bus.vocabulary.errors import ConfigError

_LARGEST = 16 << 20  # read and parsed as a whole; leaves 1.6 KiB for each of `_MOST` findings
_MOST = 10_000  # a guess: more than people would merge and annotate in one file
_CONFLICT = ("<<<<<<<", "=======", ">>>>>>>")

Name = Annotated[str, Field(max_length=1000)]
Text = Annotated[str, Field(max_length=20_000)]


def title_of(finding: FindingRecord) -> str:
    """Return the name of a finding across campaigns: its signature, and the marks that set it apart."""
    marks = {"whole system": finding.whole_system, "messages missing": finding.id.endswith("-missing")}
    return finding.signature + "".join(f" ({mark})" for mark, so in marks.items() if so)


def fingerprint_of(finding: FindingRecord) -> str:
    """Return the identifier of a finding: a hash of component and title, which contain no line numbers."""
    return _fingerprint(finding.component, title_of(finding))


def _fingerprint(component: str, title: str) -> str:
    return hashlib.sha256(f"{component}\n{title}".encode(errors="backslashreplace")).hexdigest()


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class KnownFinding(_Table):
    """A finding of the baseline.

    Attributes:
        failed: Number of the fresh `trials` that failed when it was added.
        since: Day on which it was added, and the commit if there is one.
        fixed: Day on which it was seen to be fixed, in the same form; empty until then. If it fails again, it is new.
        log: Folder with its log, relative to the folder of the file; empty if none is kept.
    """

    unit: Name
    component: Name
    monitor: Name
    title: Text
    fingerprint: Name
    severity: Name = ""
    failed: int = 0
    trials: int = 0
    since: Name = ""
    fixed: Name = ""
    note: Text = ""
    log: Name = ""

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        if self.fingerprint != _fingerprint(self.component, self.title):
            raise ValueError("fingerprint is not that of component and title")
        if os.path.isabs(self.log) or ".." in Path(self.log).parts:
            raise ValueError(f"log leads out of the folder of the file: {self.log!r}")
        return self

    @classmethod
    def of(cls, finding: FindingRecord, **more: str) -> Self:
        """Return the entry for a finding.

        Args:
            more: Values of `since`, `note` and `log`.
        """
        rate = finding.rate
        return cls(
            unit=finding.unit,
            component=finding.component,
            monitor=finding.monitor,
            title=title_of(finding).encode(errors="backslashreplace").decode(),
            fingerprint=fingerprint_of(finding),
            severity=finding.severity,
            failed=rate.count if rate else 0,
            trials=rate.total if rate else 0,
            **more,
        )

    @property
    def told(self) -> str:
        """Text that says since when it is known, or when it was fixed, with its note."""
        when = f"was fixed {self.fixed}" if self.fixed else f"since {self.since or 'some time'}"
        return when + (f" ({self.note})" if self.note else "")


class _File(_Table):
    version: Literal[1] = 1
    findings: Annotated[tuple[KnownFinding, ...], Field(max_length=_MOST)] = ()


@dataclass(frozen=True, slots=True)
class KnownFindings:
    """Contents of a baseline file."""

    path: Path
    entries: Mapping[str, KnownFinding] = field(default_factory=lambda: MappingProxyType({}))
    missing: bool = False

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read the file; a missing one gives an empty baseline.

        Raises:
            ConfigError: It cannot be read, or is not what `save` writes.
        """
        try:
            text = given_text(path, most=_LARGEST)
        except FileNotFoundError:
            return cls(path, missing=True)
        except (OSError, UnicodeError) as error:
            raise ConfigError(f"cannot read the baseline: {error}", where=str(path)) from None
        return cls(path, _by_fingerprint(_parsed(text, path), path))

    def save(self) -> Path:
        """Write the file atomically, with the findings in a fixed order, so that diffs are small.

        Raises:
            ConfigError: It cannot be written.
        """
        rows = [one.model_dump() for one in sorted(self.entries.values(), key=_place)]
        try:
            write_whole(self.path, json.dumps({"version": 1, "findings": rows}, indent=1) + "\n")
        except OSError as error:
            raise ConfigError(f"cannot write the baseline: {error.strerror}", where=str(self.path)) from None
        return self.path

    def of(self, unit: str) -> list[KnownFinding]:
        """Return the findings of a unit, the fixed ones first."""
        mine = (one for one in self.entries.values() if one.unit == unit)
        return sorted(mine, key=lambda one: (not one.fixed, _place(one)))

    def updated(self, entries: Iterable[KnownFinding]) -> Self:
        """Return a copy with entries added, or replaced where they are of the same finding."""
        both = {**self.entries, **{one.fingerprint: one for one in entries}}
        return type(self)(self.path, MappingProxyType(both))

    def folder_of(self, entry: KnownFinding) -> Path | None:
        """Return the folder in which an entry's log is kept; None if there is none.

        Raises:
            ConfigError: It lies outside of the file's folder.
        """
        if not entry.log:
            return None
        folder = self.path.parent / entry.log
        if leads_out(folder, self.path.parent):
            raise ConfigError(f"log leads out of the folder of the file: {entry.log!r}", where=str(self.path))
        return folder if FindingRecord.exists(folder) else None


def _place(one: KnownFinding) -> tuple[str, ...]:
    return one.unit, one.component, one.monitor, one.title


def _document(text: str, path: Path) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        conflict = any(line.startswith(_CONFLICT) for line in text.splitlines())
        hint = "a merge has left its marks: keep the findings of both sides" if conflict else "mend it, or delete it"
        where = f"{path}:{error.lineno}" if isinstance(error, json.JSONDecodeError) else str(path)
        raise ConfigError(f"this is not JSON: {error}", where=where, hint=hint) from None


def _parsed(text: str, path: Path) -> tuple[KnownFinding, ...]:
    document = _document(text, path)
    try:
        return _File.model_validate(document).findings
    except ValidationError as error:
        problem: Any = error.errors()[0]
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in problem["loc"]).lstrip(".")
        message = str(problem["msg"]).removeprefix("Value error, ")
        hint = "mend that entry, or delete it and run `riot ci accept` with the finding"
        raise ConfigError(message, where=f"{path}: {place}" if place else str(path), hint=hint) from None


def _by_fingerprint(entries: Iterable[KnownFinding], path: Path) -> Mapping[str, KnownFinding]:
    found: dict[str, KnownFinding] = {}
    for one in entries:
        if found.setdefault(one.fingerprint, one) is not one:
            raise ConfigError(f"the same finding twice: {one.title!r}", where=str(path), hint="delete one of them")
    return MappingProxyType(found)
