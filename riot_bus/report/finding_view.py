"""All that is known of one finding: the records that exist, the severity that follows, the next step."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from riot_bus.findings.records import (
    STEP_OF,
    ActivationRecord,
    Artefact,
    FieldsRecord,
    FindingRecord,
    MinimalRecord,
    PermeabilityRecord,
    RecordT,
    RuleRecord,
)
from riot_bus.report.format import clean, plural
from riot_bus.vocabulary.errors import ConfigError

__all__ = ["FindingView", "Severity", "TextPart", "load"]

Severity = Literal["unit only", "permeable", "activated"]

_VERBS = {"crash": "crashes", "hang": "hangs"}
_NAMED = 3


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
        broken: Files that exist but cannot be used, with the reason; they count as missing.
    """

    directory: Path
    finding: FindingRecord
    minimal: MinimalRecord | None = None
    fields: FieldsRecord | None = None
    rule: RuleRecord | None = None
    permeability: PermeabilityRecord | None = None
    activation: ActivationRecord | None = None
    broken: dict[str, str] = field(default_factory=dict)

    @property
    def steps(self) -> tuple[tuple[str, Artefact | None], ...]:
        """Every step of the chain by name, with its record."""
        records: dict[type[Artefact], Artefact | None] = {
            FindingRecord: self.finding,
            MinimalRecord: self.minimal,
            FieldsRecord: self.fields,
            RuleRecord: self.rule,
            PermeabilityRecord: self.permeability,
            ActivationRecord: self.activation,
        }
        return tuple((STEP_OF[kind.FILE], record) for kind, record in records.items())

    @property
    def next_step(self) -> str | None:
        """The first step that has not finished."""
        return next((step for step, record in self.steps if record is None), None)

    @property
    def severity(self) -> Severity:
        """The paper's triage (RIOT III): an activation counts only when at least one replay confirmed it."""
        if self.activation and self.activation.found and self.activation.replays_failed:
            return "activated"
        return "permeable" if self.permeability and self.permeability.permeable else "unit only"

    @property
    def externals(self) -> tuple[str, ...]:
        """The external fields that matter most: the region's, then the others that reach the unit."""
        region = self.activation.region if self.activation else None
        names = [region.x, region.y] if region else []
        names += list((self.activation.found or {}) if self.activation else {}) if not names else []
        names += list(self.permeability.permeable) if self.permeability and not names else []
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
        parts = [TextPart(clean(self.finding.component), code=True), TextPart(f" {self.failure}")]
        if self.rule:
            parts += [TextPart(" when "), TextPart(clean(self.rule.text, limit=400), code=True)]
        elif self.fields and self.fields.fields:
            parts += [TextPart(" depending on "), *_listed(tuple(one.name for one in self.fields.fields))]
        elif self.minimal:
            topics = _listed(self.minimal.topics)
            parts += [TextPart(f" on {plural(len(self.minimal.kept), 'message')} of "), *topics]
        else:
            parts.append(TextPart(f" on a log of {plural(self.finding.messages, 'message')}"))
        return (*parts, *self._outside(), TextPart("."))

    def _outside(self) -> list[TextPart]:
        names = _listed(self.externals)
        activation = self.activation
        if activation and activation.found:
            again = f"{activation.replays_failed} of {plural(activation.replays, 'replay')}"
            if activation.replays_failed:
                return [
                    TextPart("; the outside world reaches it through "),
                    *names,
                    TextPart(f": {again} failed again"),
                ]
            told = f"{again} failed again" if activation.replays else "not replayed yet"
            return [TextPart("; one run of the whole system failed through "), *names, TextPart(f", but {told}")]
        if self.permeability is None:
            return [TextPart("; whether the outside world can cause this has not been tested yet")]
        if not self.permeability.permeable:
            return [TextPart("; none of the external fields that were tested reaches it")]
        reached = [TextPart("; the outside world influences it through "), *names]
        if activation is None:
            return [*reached, TextPart(", not driven to the failure yet")]
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


def load(directory: Path) -> FindingView:
    """Read the records of a finding that are there.

    Args:
        directory: The finding's directory.

    Raises:
        ConfigError: `finding.json` is missing or unusable.
    """
    broken: dict[str, str] = {}

    def optional(kind: type[RecordT]) -> RecordT | None:
        if not kind.exists(directory):
            return None
        try:
            return kind.load(directory)
        except ConfigError as error:
            broken[kind.FILE] = error.message
            return None

    return FindingView(
        directory,
        FindingRecord.load(directory),
        optional(MinimalRecord),
        optional(FieldsRecord),
        optional(RuleRecord),
        optional(PermeabilityRecord),
        optional(ActivationRecord),
        broken,
    )
