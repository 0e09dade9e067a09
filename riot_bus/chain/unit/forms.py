"""Forms of a rule for use in a maintainer's code: a Python predicate, and what extensions add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from riot_bus.findings.records import FindingRecord, ProportionRecord, RuleRecord
from riot_bus.generalize.forms.python_form import python_predicate
from riot_bus.generalize.forms.tree import Terms
from riot_bus.generalize.rule import Rule
from riot_bus.plugins import RULE_FORMS
from riot_bus.report.regression import file_stem
from riot_bus.vocabulary.errors import ConfigError


@dataclass(frozen=True, slots=True)
class WrittenRule:
    """A rule that is to be written in some form: what the entry points `riot_bus.rule_forms` get.

    Attributes:
        terms: The rule.
        types: Type of each field that it names.
        scale: Nominal spread of each field.
        lines: Description of the rule for a comment.
        name: Name of the finding, usable in an identifier.
        folder: The finding's folder, to write a file to.
    """

    terms: Terms
    types: Mapping[str, str]
    scale: Mapping[str, float]
    lines: Sequence[str]
    name: str
    folder: Path


def with_forms(record: RuleRecord, finding: FindingRecord, folder: Path) -> RuleRecord:
    """Write the rule in all forms into the finding's folder, and return its record with what they add to it."""
    terms, types = Rule.from_json(record.rule).terms, dict(record.types)
    lines = [
        f"{finding.component} fails: {finding.signature}",
        f"It fails when {record.text}",
        f"Precision {_rate(record.precision)}, recall {_rate(record.recall)}.",
    ]
    rule = WrittenRule(terms, types, record.scale, lines, file_stem(finding), folder)
    with suppress(ConfigError):
        record = record.model_copy(update={"python": python_predicate(terms, types=types, told=record.text)})
    for form in RULE_FORMS.targets():
        update: Mapping[str, Any] = RULE_FORMS.load(form)(rule)
        record = record.model_copy(update=update)
    return record


def _rate(one: ProportionRecord) -> str:
    return f"{one.count} of {one.total} fresh trials" if one.total else "not tested"
