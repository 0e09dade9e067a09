"""View of a finding that all reports share: its records, the severity that follows from them, the next step."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.backtrack import BacktrackRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import Artefact, FieldsRecord, FindingRecord, MinimalRecord, RecordT, RuleRecord
from riot_bus.findings.steps import STEPS, ChainStep, find_step, further_steps
from riot_bus.given_files import leads_out
from riot_bus.report.format import clean, plural
from riot_bus.statistics.rates import chance_of_difference
from riot_bus.vocabulary.errors import ConfigError, RiotError

Severity = Literal["unit only", "permeable", "activated", "whole system"]

_VERBS = {
    "crash": "crashes",
    "hang": "hangs",
    "exit": "ends",
    "silent": "stays silent",
    "limit": "hits a limit",
    "mined": "is not as in nominal trials",
}
_NAMED = 3
_VARIED = re.compile(r" ?\[((end of )?part \d|point \d|amplitude|period|one message|place of the message)\]\Z")
"""Suffix of a field's name where it varies in time; the suffix alone is not a field."""
EVIDENCE = "evidence"
"""Folder of a finding with the files that a failing trial has left."""
_TOLD = (FindingRecord, MinimalRecord, FieldsRecord, RuleRecord, PermeabilityRecord, ActivationRecord)


@dataclass(frozen=True, slots=True)
class TextPart:
    """A piece of a sentence; `code` marks names, rules and other text that is not ours."""

    text: str
    code: bool = False


@dataclass(frozen=True, slots=True)
class FindingView:
    """The records of a finding; `None` for steps that have not finished.

    Attributes:
        directory: The finding's directory, as the user gave it.
        finding: Record of the failure.
        steps: Every step of the chain with its record, and finished steps of other packages; for a finding in runs of
            the whole system, only the test, as the others need the unit's own input.
        broken: Files that exist but cannot be used, with the reason; they count as missing.
        backtrack: Paths from external fields, from nominal logs alone (`riot backchain`); None if they were not asked.
    """

    directory: Path
    finding: FindingRecord
    steps: tuple[tuple[ChainStep, Artefact | None], ...]
    broken: dict[str, str] = field(default_factory=dict)
    backtrack: BacktrackRecord | None = None

    @property
    def minimal(self) -> MinimalRecord | None:
        """The few messages that are needed."""
        return self._record(MinimalRecord)

    @property
    def fields(self) -> FieldsRecord | None:
        """The relevant fields."""
        return self._record(FieldsRecord)

    @property
    def rule(self) -> RuleRecord | None:
        """The rule over them."""
        return self._record(RuleRecord)

    @property
    def permeability(self) -> PermeabilityRecord | None:
        """Which external fields reach them."""
        return self._record(PermeabilityRecord)

    @property
    def activation(self) -> ActivationRecord | None:
        """The external inputs that make the whole system fail."""
        return self._record(ActivationRecord)

    @property
    def further(self) -> tuple[tuple[ChainStep, Artefact], ...]:
        """The finished steps that have no section of their own in a report."""
        return tuple((step, record) for step, record in self.steps if record and not isinstance(record, _TOLD))

    def _record(self, kind: type[RecordT]) -> RecordT | None:
        return next((record for _, record in self.steps if isinstance(record, kind)), None)

    @property
    def next_step(self) -> str | None:
        """The first unfinished step that has the external fields it needs."""
        outside = self.finding.external
        return next(
            (step.name for step, record in self.steps if record is None and (outside or not step.whole_system)), None
        )

    @property
    def severity(self) -> Severity:
        """The paper's triage (RIOT III): an activation counts only when replays have confirmed it.

        Findings in runs of the whole system are outside of this triage, since the unit alone was not tested.
        """
        if self.finding.whole_system:
            return "whole system"
        if self.activated:
            return "activated"
        return "permeable" if self.permeability and self.permeability.permeable else "unit only"

    @property
    def activated(self) -> bool:
        """Whether replays of what was found failed, and significantly more often than runs with nominal inputs."""
        one = self.activation
        if one is None or not one.found or not one.replays_failed:
            return False
        chance = chance_of_difference(one.replays_failed, one.replays, one.controls_failed, one.controls)
        return not one.controls or chance <= 0.05

    @property
    def externals(self) -> tuple[str, ...]:
        """The external fields of the activation and those that bound its region; else those that reach the unit."""
        activation = self.activation
        names = [_VARIED.sub("", name) for name in (activation.found if activation else None) or ()]
        if activation and activation.region:
            names += [each.field for each in activation.region.ranges if len(each.ends) <= 1]
        names = [name for name in names if name] or list(self.permeability.permeable if self.permeability else ())
        return tuple(dict.fromkeys(names))

    def command(self, step: str) -> str:
        """Return the command line that runs a step on this finding, quoted for a shell."""
        path = str(self.directory)
        return f"riot {step} {shlex.quote(f'./{path}' if path.startswith('-') else path)}"

    @property
    def failure(self) -> str:
        """What the component does, as a verb."""
        return _VERBS.get(self.finding.monitor, f"violates {clean(self.finding.monitor, limit=60)}")

    def verdict(self) -> tuple[TextPart, ...]:
        """Return the finding in one sentence."""
        if self.finding.whole_system:
            return self._in_system()
        parts = [TextPart(clean(self.finding.component), code=True), TextPart(f" {self.failure}")]
        if self.rule:
            parts += [TextPart(" when "), TextPart(clean(self.rule.text, limit=400), code=True)]
            if told := self.rule.shortcomings:
                parts.append(TextPart(f" ({told})"))
        elif self.fields and self.fields.fields:
            parts += [TextPart(" depending on "), *_listed(tuple(one.name for one in self.fields.fields))]
        elif self.minimal:
            topics = _listed(self.minimal.topics)
            parts += [TextPart(f" on {plural(len(self.minimal.kept), 'message')} of "), *topics]
        else:
            parts.append(TextPart(f" on a log of {plural(self.finding.messages, 'message')}"))
        return (*parts, *self._outside(), TextPart("."))

    @property
    def verdict_text(self) -> str:
        """The verdict as plain text."""
        return "".join(part.text for part in self.verdict())

    def facts(self) -> dict[str, str]:
        """Return what programs are told of the finding, by name; may contain untrusted text."""
        found = {"signature": self.finding.signature, "severity": self.finding.severity, "reach": self.severity}
        found |= {"rule": self.rule.text if self.rule else "", "reproduce": self.command("reproduce")}
        return {name: text for name, text in found.items() if text}

    def _in_system(self) -> tuple[TextPart, ...]:
        finding, rate = self.finding, self.finding.rate
        topics = tuple(dict.fromkeys(str(each.get("topic")) for each in finding.injections))
        again = f": {rate.count} of {plural(rate.total, 'further run')} failed again" if rate else ""
        what = f"{plural(finding.modified, 'change')} to messages from outside"
        return (
            TextPart(clean(finding.component), code=True),
            TextPart(f" {self.failure} in runs of the whole system with "),
            *((TextPart(f"{what}, on "), *_listed(topics)) if topics else (TextPart("nothing changed"),)),
            TextPart(f"{again}."),
        )

    def _outside(self) -> list[TextPart]:
        names = _listed(self.externals)
        activation = self.activation
        if activation and activation.found:
            again = f"{activation.replays_failed} of {plural(activation.replays, 'replay')} failed again"
            if self.activated:
                return [TextPart("; the outside world reaches it through "), *names, TextPart(f": {again}")]
            told = again if activation.replays else "not replayed yet"
            if activation.replays_failed:
                nominal = f"{activation.controls_failed} of {activation.controls}"
                told += f", not significantly more often than with nominal inputs ({nominal})"
            return [TextPart("; one run of the whole system failed through "), *names, TextPart(f", but {told}")]
        if self.permeability is None:
            return [TextPart("; whether the outside world can cause this is not known")]
        if not self.permeability.edges:
            return [TextPart("; whether any external field reaches it could not be determined")]
        if not self.permeability.permeable:
            return [TextPart("; none of the external fields that were tested reaches it")]
        reached = [TextPart("; the outside world influences it through "), *names]
        if activation is None:
            return [*reached, TextPart(", not driven to the failure yet")]
        if not activation.runs:
            return [*reached, TextPart(f"; whether it fails there was {clean(activation.text, limit=400)}")]
        return [*reached, TextPart(f", but {plural(activation.runs, 'system run')} did not make it fail")]


def _listed(names: tuple[str, ...]) -> list[TextPart]:
    shown = names[:_NAMED]
    parts: list[TextPart] = []
    for place, name in enumerate(shown):
        if place:
            parts.append(TextPart(" and " if place + 1 == len(shown) == len(names) else ", "))
        parts.append(TextPart(clean(name, limit=120), code=True))
    if len(names) > _NAMED:
        parts.append(TextPart(f" and {len(names) - _NAMED} more"))
    return parts or [TextPart("no field")]


def evidence_files(directory: Path) -> list[Path]:
    """Return the files that a failing trial has left in a finding's folder, sorted; links out of it are left out."""
    found = sorted((directory / EVIDENCE).glob("*"))
    return [path for path in found if path.is_file() and not leads_out(path, directory)]


def tail_of(path: Path, most: int) -> str:
    """Return the end of a file that a failing trial has left, as text of so many bytes at most."""
    with path.open("rb") as stream:
        stream.seek(max(0, path.stat().st_size - most))
        return stream.read().decode(errors="replace")


def load(directory: Path) -> FindingView:
    """Read the records of a finding that are there.

    Raises:
        ConfigError: `finding.json` is missing or unusable.
    """
    broken: dict[str, str] = {}

    def read(kind: type[RecordT]) -> RecordT | None:
        if not kind.exists(directory):
            return None
        try:
            return kind.load(directory)
        except ConfigError as error:
            broken[kind.FILE] = error.message
            return None

    finding = FindingRecord.load(directory)
    steps: list[tuple[ChainStep, Artefact | None]] = [(STEPS[0], finding)]
    steps += [(step, read(step.kind)) for step in STEPS[1:] if not finding.whole_system]
    done = [name for name in further_steps() if (directory / f"{name}.json").exists() and not finding.whole_system]
    for name in done:  # others are not imported
        try:
            step = find_step(name)
        except RiotError as error:
            broken[f"step {name}"] = error.message
            continue
        record = read(step.kind)
        if record is not None:
            steps.append((step, record))
    return FindingView(directory, finding, tuple(steps), broken, read(BacktrackRecord))
