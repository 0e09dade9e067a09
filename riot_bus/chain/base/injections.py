"""Injections as findings and the store of trials keep them."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal

_KINDS: dict[str, type[Formula | Curve]] = {"text": Formula, "times": Curve}
"""Types that give a value per message, by an attribute that no other type has."""


def injection_of(row: Mapping[str, Any], where: str) -> Injection:
    """Return an injection that was written as JSON.

    Raises:
        ConfigError: It is not an injection.
    """
    known = {each.name for each in fields(Injection)}
    for name in row.keys() - known:
        raise ConfigError(f"unknown key {name!r} in an injection", where=where, hint=did_you_mean(name, known))
    values = dict(row)
    value = values.get("value")
    try:
        if isinstance(value, dict):
            kind = next((kind for key, kind in _KINDS.items() if key in value), Signal)
            several = {name: tuple(map(_scalar, one)) for name, one in value.items() if isinstance(one, list | tuple)}
            values["value"] = kind(**{**value, **several})
        else:
            values["value"] = _scalar(value)
        values["options"] = tuple((str(name), _scalar(value)) for name, value in values.get("options", ()))
        return Injection(**values)
    except (TypeError, ValueError, SyntaxError, RecursionError) as error:
        raise ConfigError(f"this injection cannot be used: {error}", where=where) from None


def _scalar(value: Any) -> Any:
    if isinstance(value, dict | list):
        raise TypeError(f"{value!r} is not a single value")
    if isinstance(value, str) and re.match(r"b['\"]", value):  # bytes, as Python writes them
        return ast.literal_eval(value)
    return value
