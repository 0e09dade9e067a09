"""Forms of a rule for use in a maintainer's code: files in the finding's folder, and a formula."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from riot_bus.generalize.forms.cpp_form import cpp_file
from riot_bus.generalize.forms.python_form import python_file, python_predicate
from riot_bus.generalize.forms.stl_form import NoFormulaError, stl_formula
from riot_bus.generalize.rule import Rule
from riot_bus.report.formats import write_file
from riot_bus.report.regression import file_stem
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus.findings.records import FindingRecord, ProportionRecord, RuleRecord

__all__ = ["CPP", "PYTHON", "with_forms"]

PYTHON, CPP = "sanitize.py", "sanitize.hpp"


def with_forms(record: RuleRecord, finding: FindingRecord, folder: Path) -> RuleRecord:
    """Write the rule as Python and C++ into the finding's folder, and return its record with the formula.

    Args:
        record: Record of the rule.
        finding: Record of its finding.
        folder: The finding's folder.
    """
    terms, types = Rule.from_json(record.rule).terms, dict(record.types)
    told = [
        f"{finding.component} fails: {finding.signature}",
        f"It fails when {record.text}",
        f"Precision {_rate(record.precision)}, recall {_rate(record.recall)}.",
    ]
    for name in (PYTHON, CPP):
        (folder / name).unlink(missing_ok=True)  # of an earlier rule
    try:
        write_file(python_file(terms, types=types, scale=record.scale, told=told), folder / PYTHON)
        source = python_predicate(terms, types=types, told=record.text)
        record = record.model_copy(update={"python": source})
        formula, signals = stl_formula(terms, types=types)
        record = record.model_copy(update={"stl": formula, "stl_signals": signals})
    except (ConfigError, NoFormulaError) as why:
        record = record.model_copy(update={"stl_missing": str(why)})
    with suppress(ConfigError):  # integers that C++ does not have
        name = f"riot_{file_stem(finding)}".lower()
        write_file(cpp_file(terms, types=types, scale=record.scale, name=name, told=told), folder / CPP)
    return record


def _rate(one: ProportionRecord) -> str:
    return f"{one.count} of {one.total} fresh trials" if one.total else "not tested"
