"""Injection plans: TOML files that people write (docs/interceptors.md)."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from riot_bus.config.toml_file import explained_key
from riot_bus.given_files import MOST_TOML, given_text
from riot_bus.inject.faults import ATTRIBUTES, fault_class
from riot_bus.inject.formula import parse_formula
from riot_bus.inject.mutations import HexBytes
from riot_bus.pipeline.conditions import window_problem
from riot_bus.plugin_options import instance_of, options_of
from riot_bus.vocabulary.errors import ConfigError, did_you_mean, located
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.vocabulary.toml_text import parse_toml

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_STRICT = ConfigDict(extra="forbid", strict=True)
_VALUES = ("value", "signal", "curve", "formula")
"""Keys that say what a field is set to."""


_Written = bool | int | float | str | HexBytes


class _Signal(BaseModel):
    model_config = _STRICT
    center: _Finite
    amplitude: Annotated[_Finite, Field(ge=0)]
    hold: Annotated[int, Field(ge=1)] = 5
    seed: int | None = None
    integer: bool = False
    choices: list[_Written] = []


class _Curve(BaseModel):
    model_config = _STRICT
    times: list[_Finite]
    values: list[_Finite]
    integer: bool = False


class _Formula(BaseModel):
    model_config = _STRICT
    text: Annotated[str, Field(min_length=1)]
    base: str = ""


class _Inject(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True)  # a kind of fault may have options of its own
    topic: Annotated[str, Field(min_length=1)]
    field: Annotated[str, Field(min_length=1)] | None = None
    value: _Written | None = None
    signal: _Signal | None = None
    curve: _Curve | None = None
    formula: str | _Formula | None = None
    fault: str = "set"
    start: _Seconds = 0.0
    end: _Seconds | None = None
    first: Annotated[int, Field(ge=0)] = 0
    last: Annotated[int, Field(ge=0)] | None = None
    where: str | None = None
    probability: Annotated[float, Field(ge=0, le=1)] = 1.0
    delay: _Seconds = 0.0
    copies: Annotated[int, Field(ge=1)] = 1
    seed: int | None = None


class _Plan(BaseModel):
    model_config = _STRICT
    seed: int = 0
    inject: list[_Inject] = []


def read_plan(path: Path | str) -> tuple[Injection, ...]:
    """Read an injection plan.

    Raises:
        ConfigError: The file is missing, is not TOML, or a key or value in it is wrong.
    """
    return parse_plan(plan_text(Path(path)), name=str(path))


def plan_text(path: Path) -> str:
    """Return the text of an injection plan; raises ConfigError if the file cannot be read."""
    try:
        return given_text(path, most=MOST_TOML)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"cannot read the injection plan: {reason}", where=str(path)) from error


def parse_plan(text: str, *, name: str) -> tuple[Injection, ...]:
    """Read an injection plan from a text.

    Raises:
        ConfigError: It is not TOML, or a key or value in it is wrong.
    """
    document = parse_toml(text, where=name)
    try:
        plan = _Plan.model_validate(document)
    except ValidationError as error:
        tags = ("bool", "int", "float", "str", "HexBytes", "_Formula")
        raise explained_key(error, name, tags, _table_at) from None
    return tuple(_injection(each, plan.seed, f"{name}: inject[{index}]") for index, each in enumerate(plan.inject))


def _check(entry: _Inject, where: str) -> dict[str, Scalar]:
    """Check a table as a whole; return the options that belong to its kind of fault."""
    with located(f"{where}.fault"):
        declared = options_of(fault_class(entry.fault))
    own = dict(entry.model_extra or {})
    for key in own.keys() - declared.keys():
        hint = did_you_mean(key, [*_Inject.model_fields, *declared])
        raise ConfigError(f"unknown key {key!r}", where=f"{where}.{key}", hint=hint)
    problem = _problem(entry, declared)
    if problem:
        raise ConfigError(problem, where=where)
    return {key: _option(value, f"{where}.{key}") for key, value in own.items()}


def _option(value: Any, where: str) -> Scalar:
    try:
        return _scalar(TypeAdapter[_Written](_Written).validate_python(value, strict=True))
    except ValidationError:
        hint = "write a number, true, false, a text, or {hex = ...} for bytes"
        raise ConfigError(f"an option is one value (found {value!r})", where=where, hint=hint) from None


def _scalar(value: _Written) -> Scalar:
    return bytes.fromhex(value.hex) if isinstance(value, HexBytes) else value


def _problem(entry: _Inject, declared: Container[str]) -> str | None:
    given = entry.model_fields_set
    if entry.fault == "set" and entry.field is None:
        return "which field is to be set? add field = \"...\", or fault = 'drop', 'delay', ..."
    if "value" in declared and [getattr(entry, name) for name in _VALUES].count(None) != len(_VALUES) - 1:
        return f"give either {', '.join(_VALUES[:-1])} or {_VALUES[-1]}"
    if "field" not in declared and given & {"field", *_VALUES}:
        return f"fault = {entry.fault!r} takes no field, {', '.join(_VALUES[:-1])} or {_VALUES[-1]}"
    if ("delay" in declared) != (entry.delay > 0):
        return "delay = SECONDS (> 0) belongs to fault = 'delay', and only there"
    if "copies" in given and "copies" not in declared:
        return "copies belongs to fault = 'duplicate'"
    return window_problem(entry.start, entry.end, entry.first, entry.last)


def _injection(entry: _Inject, seed: int, where: str) -> Injection:
    further = _check(entry, where)
    selector = parse_selector(entry.topic)
    if selector.topic != entry.topic:
        raise ConfigError(
            f"topic = {entry.topic!r} is more than a topic",
            where=f"{where}.topic",
            hint=f"write topic = {selector.topic!r}, and the rest as field = ... and where = ...",
        )
    if entry.field is not None:
        with located(f"{where}.field"):
            parse_selector(f"x:{entry.field}")
    if entry.where is not None:
        with located(f"{where}.where"):
            parse_predicate(entry.where)
    own = {each.name for each in fields(Injection)} - {"value", "seed", "options"}
    made = Injection(
        **{name: getattr(entry, name) for name in own},
        value=_value(entry, seed, where),
        seed=seed if entry.seed is None else entry.seed,
        options=tuple(sorted(further.items())),
    )
    kind = fault_class(entry.fault)
    values = {name: getattr(made, name) for name in ATTRIBUTES if name in options_of(kind)}
    instance_of(kind, values | further, lambda key: f"{where}.{key}" if key else where)
    return made


def _value(entry: _Inject, seed: int, where: str) -> Scalar | Signal | Curve | Formula | None:
    if (signal := entry.signal) is not None:
        own = seed if signal.seed is None else signal.seed
        choices = tuple(map(_scalar, signal.choices))
        return Signal(signal.center, signal.amplitude, signal.hold, own, signal.integer, choices)
    if (curve := entry.curve) is not None:
        try:
            return Curve(tuple(curve.times), tuple(curve.values), curve.integer)
        except ValueError as error:
            raise ConfigError(str(error), where=f"{where}.curve") from None
    if entry.formula is not None:
        return _formula(entry.formula, where)
    return None if entry.value is None else _scalar(entry.value)


def _formula(written: str | _Formula, where: str) -> Formula:
    formula = Formula(written) if isinstance(written, str) else Formula(written.text, written.base)
    with located(f"{where}.formula"):
        parse_formula(formula.text)
        if formula.base:
            parse_selector(f"x:{formula.base}")
    return formula


def _table_at(place: list[str | int]) -> type[BaseModel]:
    tables: dict[int, type[BaseModel]] = {1: _Plan, 3: _Inject}
    inner: dict[str, type[BaseModel]] = {"signal": _Signal, "curve": _Curve, "formula": _Formula}
    return tables.get(len(place)) or next((inner[str(name)] for name in place if name in inner), HexBytes)
