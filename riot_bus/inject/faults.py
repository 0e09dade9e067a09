"""Kinds of faults: what happens to a message that an injection selects; found by the entry points `riot_bus.faults`.

A kind is a class whose fields are the keys that a plan's table takes for it. `field`, `value`, `delay` and `copies` are
attributes of the injection, all others are among its `options`. Which messages are selected is up to the plan.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, partial
from typing import Annotated, Any, Literal, Protocol

from pydantic import Field

from riot_bus.inject.formula import evaluate, parse_formula
from riot_bus.pipeline.event import Change, Event
from riot_bus.plugin_options import REQUIRED, options_of
from riot_bus.plugins import FAULTS
from riot_bus.types.capabilities import OmitsFields, StandIn
from riot_bus.types.elements import fit_value, set_field
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.message import Scalar

ATTRIBUTES = ("field", "value", "delay", "copies")
"""Options that an `Injection` has attributes for."""

_DEFAULTS = {each.name: each.default for each in fields(Injection)} | {"signal": None, "formula": None}


class FaultKind(Protocol):
    """What is done to each message that an injection selects."""

    def apply(self, event: Event) -> None:
        """Apply the fault to a message.

        Raises:
            PayloadError: It cannot be applied to this message, which is passed unchanged.
        """
        ...


@dataclass(frozen=True, slots=True)
class SetFault:
    """Set a field.

    Attributes:
        field: Path of the field; with `[*]`, of many fields.
        value: Value that it is set to.
    """

    field: str
    value: Any

    def __post_init__(self) -> None:
        if self.field is None or self.value is None:
            raise ConfigError("this injection sets nothing", hint="give field and value")
        if isinstance(self.value, Formula):
            parse_formula(self.value.text)

    def apply(self, event: Event) -> None:
        """Set it."""
        path, value = self.field, _value(self.value, self.field, event)
        if "[*]" not in path:
            event.set(path, fit_value(value, event.read(path)))
            return
        kind = event.type
        if kind is None:
            event.read(path)  # raises the right error
            return
        payload = set_field(kind, event.payload, path, partial(fit_value, value))
        event.patched(payload, Change(event.interceptor, "set", path, None, value))


@dataclass(frozen=True, slots=True)
class DropFault:
    """Drop the message."""

    def apply(self, event: Event) -> None:
        """Drop it."""
        event.drop()


@dataclass(frozen=True, slots=True)
class DelayFault:
    """Deliver the message later.

    Attributes:
        delay: Delay, seconds.
    """

    delay: Annotated[float, Field(gt=0, allow_inf_nan=False)]

    def apply(self, event: Event) -> None:
        """Delay it."""
        event.delay(self.delay)


@dataclass(frozen=True, slots=True)
class DuplicateFault:
    """Deliver the message more than once.

    Attributes:
        copies: Number of further copies.
    """

    copies: Annotated[int, Field(ge=1)] = 1

    def apply(self, event: Event) -> None:
        """Copy it."""
        event.duplicate(self.copies)


@dataclass(frozen=True, slots=True)
class OmitFault:
    """Leave out a field of a format without type definitions (JSON, MessagePack, CBOR).

    Attributes:
        field: Path of the field, which may be a list or a map with all that it contains.
        null: Whether null takes its place.
        empty: Empty container that takes its place, `list` or `map`; nothing does if this is empty.
    """

    field: str
    null: bool = False
    empty: Literal["", "list", "map"] = ""

    def apply(self, event: Event) -> None:
        """Leave it out."""
        kind: object = event.type
        if kind is None:
            event.read(self.field)  # raises the right error
        if not isinstance(kind, OmitsFields):
            raise PayloadError("messages of this type have all their fields", where=self.field)
        instead: StandIn | None = "null" if self.null else self.empty or None
        payload = kind.omit(event.payload, self.field, instead=instead)
        try:
            before = event.read(self.field)
        except PayloadError:  # it is a list or a map
            before = None
        event.patched(payload, Change(event.interceptor, instead or "omit", self.field, before))


@dataclass(frozen=True, slots=True)
class TruncateFault:
    """Cut the payload off.

    Attributes:
        keep: Share of its bytes that is kept.
    """

    keep: Annotated[float, Field(ge=0, lt=1)] = 0.5

    def apply(self, event: Event) -> None:
        """Cut it."""
        event.replace(event.payload[: int(self.keep * len(event.payload))])


@cache
def fault_class(name: str) -> type[FaultKind]:
    """Return a kind of fault by its name; raises ConfigError if there is none that can be used."""
    kind = FAULTS.load(name)
    if not isinstance(kind, type) or not callable(getattr(kind, "apply", None)):
        hint = "its entry point has to name a class with a method apply(self, event)"
        raise ConfigError(f"fault kind {name!r} cannot be used", where=FAULTS.targets()[name], hint=hint)
    for option, (_, default) in options_of(kind).items():
        if option in _DEFAULTS and (option not in ATTRIBUTES or default not in (REQUIRED, _DEFAULTS[option])):
            text = f"fault kind {name!r} cannot be used: {option!r} is a key of every injection, not its own"
            raise ConfigError(text, where=FAULTS.targets()[name], hint="give this option another name")
    return kind


def fault_of(injection: Injection) -> FaultKind:
    """Return the fault of an injection, ready to be applied.

    Raises:
        ConfigError: There is no such kind, or it refuses its options.
    """
    kind = fault_class(injection.fault)
    declared = options_of(kind)
    values = {name: getattr(injection, name) for name in ATTRIBUTES if name in declared} | dict(injection.options)
    try:
        return kind(**values)
    except TypeError as error:
        text = f"fault kind {injection.fault!r} does not take these options: {error}"
        raise ConfigError(text, hint=f"its options: {', '.join(declared) or 'none'}") from error


def _value(value: Scalar | Signal | Curve | Formula, path: str, event: Event) -> Scalar:
    if isinstance(value, Signal):
        return value.injected(event.index)
    if isinstance(value, Curve):
        return value.value(event.seconds)
    if not isinstance(value, Formula):
        return value
    kind = event.type
    if kind is None:
        return event.read(path)  # raises the right error
    original = event.original.payload
    return evaluate(value, lambda each: kind.read(original, each))
