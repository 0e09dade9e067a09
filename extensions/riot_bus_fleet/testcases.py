"""Test cases for other logs: the injections of a plan, of a finding, or of the provenance in a log."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from riot_bus.chain.base.injections import injection_of
from riot_bus.chain.base.workspace import open_finding
from riot_bus.findings.records import FieldsRecord, FindingRecord
from riot_bus.inject.plan import read_plan
from riot_bus.log.layout import Role
from riot_bus.log.reader import LogReader
from riot_bus.pipeline.event import Change
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection

_ROLES: tuple[Role, ...] = ("original", "delivered")
_ELEMENT = re.compile(r"\[\d+\]$")


@dataclass(frozen=True, slots=True)
class CaseTemplate:
    """A test case without its log."""

    __test__ = False  # not a pytest class

    injections: tuple[Injection, ...]
    signature: str | None = None
    unit: str | None = None
    system: str | None = None

    def digest(self) -> str:
        """Return a hash of what decides the outcome."""
        text = json.dumps([[each.row() for each in self.injections], self.signature], sort_keys=True, default=repr)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def anywhere(self) -> CaseTemplate:
        """Return it with injections into all messages of their topics, not only those with certain numbers or times."""
        wide = (replace(each, start=0.0, end=None, first=0, last=None) for each in self.injections)
        return replace(self, injections=tuple(dict.fromkeys(wide)))


def load_case_template(path: Path) -> CaseTemplate:
    """Read a test case.

    Args:
        path: An injection plan (`.toml`), the folder of a finding, its `fields.json` (the values that its certificates
            found to fail, for all messages), or a log whose provenance tells what was changed.

    Raises:
        ConfigError: It is none of these, or injects nothing.
    """
    if path.suffix == ".toml":
        found = CaseTemplate(read_plan(path))
    elif path.name == FieldsRecord.FILE:
        found = replace(_of_finding(path.parent), injections=_certificates(FieldsRecord.load(path.parent)))
    elif path.suffix == ".mcap":
        near = _of_finding(path.parent) if FindingRecord.exists(path.parent) else CaseTemplate(())
        found = _of_log(path, near)
    elif path.is_dir():
        found = _of_finding(open_finding(path)[0])
    else:
        hint = "name a plan (.toml), the folder of a finding, its fields.json, or a log (.mcap)"
        raise ConfigError("not a test case" if path.exists() else "no such file", where=str(path), hint=hint)
    if not found.injections:
        raise ConfigError("it injects nothing", where=str(path), hint="name an injection plan or a finding")
    return found


def _of_finding(folder: Path) -> CaseTemplate:
    finding = FindingRecord.load(folder)
    if finding.whole_system:
        raise ConfigError(
            "this was found in runs of the whole system, so it is not a test case of a unit",
            where=str(folder),
            hint="name a finding of `riot test` without --whole-system, or an injection plan",
        )
    where = str(folder / FindingRecord.FILE)
    injections = tuple(injection_of(each, where) for each in finding.injections)
    return CaseTemplate(injections, finding.signature, finding.unit, finding.system_file)


def _certificates(record: FieldsRecord) -> tuple[Injection, ...]:
    found = []
    for each in record.fields:
        topic, _, path = each.name.rpartition(":")
        if each.kind == "exceptional":
            found.append(Injection(_ELEMENT.sub("", topic), path, each.certificate.failing))
    return tuple(dict.fromkeys(found))


def _of_log(path: Path, near: CaseTemplate) -> CaseTemplate:
    """Return the fields set according to a log's provenance, message by message; other changes are left out."""
    with LogReader(path) as reader:
        changed: dict[tuple[str, int], tuple[Change, ...]] = {}
        for entry in reader.provenance():
            changed.setdefault((entry.key, entry.sequence), entry.changes)
        names = {each.key: each.name for each in reader.recorded_topics()}
        numbers: Counter[str] = Counter()
        found: list[Injection] = []
        named = ((each.key, each.sequence) for role in _ROLES for each in reader.messages(role=role))
        for key, sequence in dict.fromkeys(sorted(named, key=lambda each: each[1])):
            topic = names.get(key, key)
            number = numbers[topic]
            numbers[topic] += 1
            found += [
                Injection(topic, change.field, change.after, first=number, last=number)
                for change in changed.get((key, sequence), ())
                if change.field is not None and change.after is not None
            ]
        signature = near.signature or reader.metadata.get("signature")
    return replace(near, injections=tuple(found) or near.injections, signature=signature)
