"""Injection plans as TOML, so that tests can read back what they wrote."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields

from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.toml_text import toml_value


def plan_to_toml(injections: Iterable[Injection]) -> str:
    """Return the plan as TOML; `read_plan` gives the same injections back."""
    blocks = []
    for injection in injections:
        lines = ["[[inject]]"]
        for field in fields(Injection):
            value = getattr(injection, field.name)
            if isinstance(value, Signal | Curve):
                told = {each.name: getattr(value, each.name) for each in fields(value)}
                inside = ", ".join(f"{name} = {toml(one)}" for name, one in told.items() if one != ())
                lines.append(f"{type(value).__name__.lower()} = {{ {inside} }}")
            elif isinstance(value, Formula):
                lines.append(f"formula = {{ text = {toml(value.text)}, base = {toml(value.base)} }}")
            elif field.name == "options":
                lines += [f"{name} = {toml(each)}" for name, each in injection.options]
            elif value is not None and (value != field.default or field.name == "value"):
                lines.append(f"{field.name} = {toml(value)}")
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def toml(value: object) -> str:
    return f'{{ hex = "{value.hex()}" }}' if isinstance(value, bytes) else toml_value(value)
