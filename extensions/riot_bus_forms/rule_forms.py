"""What this package adds to a finding's rule: a Python file, a C++ header, and a formula of signal temporal logic."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from riot_bus.report.formats import write_file
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_forms.cpp_form import cpp_file
from riot_bus_forms.python_file import python_file
from riot_bus_forms.stl_form import NoFormulaError, stl_formula

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.chain.unit.forms import WrittenRule

PYTHON, CPP = "sanitize.py", "sanitize.hpp"


def python(rule: WrittenRule) -> Mapping[str, Any]:
    """Write the rule as a Python file."""
    (rule.folder / PYTHON).unlink(missing_ok=True)  # of an earlier rule
    with suppress(ConfigError):
        text = python_file(rule.terms, types=rule.types, scale=rule.scale, told=rule.lines)
        write_file(text, rule.folder / PYTHON)
    return {}


def cpp(rule: WrittenRule) -> Mapping[str, Any]:
    """Write the rule as a C++ header, unless C++ does not have its integers."""
    (rule.folder / CPP).unlink(missing_ok=True)  # of an earlier rule
    with suppress(ConfigError):
        name = f"riot_{rule.name}".lower()
        text = cpp_file(rule.terms, types=rule.types, scale=rule.scale, name=name, told=rule.lines)
        write_file(text, rule.folder / CPP)
    return {}


def stl(rule: WrittenRule) -> Mapping[str, Any]:
    """Return the rule as a formula, or why there is none."""
    try:
        formula, signals = stl_formula(rule.terms, types=rule.types)
    except (ConfigError, NoFormulaError) as why:
        return {"stl_missing": str(why)}
    return {"stl": formula, "stl_signals": signals}
