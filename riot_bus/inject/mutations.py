"""Mutations: fields of one message that are changed together, so that they contradict each other.

They are part of a dictionary file (docs/dictionaries.md), and apply wherever their type occurs: in messages of that
type, and in all messages that contain one. A text is a formula over the message as it was before; literal text has
quotes of its own: `"'rgb8'"`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from riot_bus.inject.formula import evaluate, join_path, parse_formula
from riot_bus.types.elements import fit_value, set_field
from riot_bus.types.model import MessageType
from riot_bus.vocabulary.errors import located
from riot_bus.vocabulary.injection import Formula
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.selector import parse_selector

_STRICT = ConfigDict(extra="forbid", strict=True, use_attribute_docstrings=True)

Changes = tuple[tuple[str, "Scalar | Formula"], ...]
"""Paths and their new values, in the order in which they are set."""


@dataclass(frozen=True, slots=True)
class Mutation:
    """Fields of one message that are changed together.

    Attributes:
        changes: New value of each field by path.
        consistent: Formula that is true of sound messages and false of mutated ones; empty if these are only unusual.
        opt_in: Whether it is only tried where the user asked for all of its fields.
        source: Entry and file that it comes from.
        own: Whether that file is the user's own.
    """

    type: str
    changes: Changes
    reason: str
    consistent: str = ""
    opt_in: bool = False
    source: str = ""
    own: bool = False

    def at(self, base: str) -> Changes:
        """Return the changes for a message of this type that is nested at a path of another one."""
        return tuple(
            (join_path(base, path), Formula(value.text, base) if isinstance(value, Formula) else value)
            for path, value in self.changes
        )


def mutate(kind: MessageType, payload: bytes, changes: Iterable[tuple[str, Scalar | Formula]]) -> bytes:
    """Return a payload with all changes made.

    Raises:
        PayloadError: A field is missing, or a formula has no value that the field can hold.
    """
    original = payload
    for path, wanted in changes:
        value = evaluate(wanted, lambda each: kind.read(original, each)) if isinstance(wanted, Formula) else wanted
        payload = set_field(kind, payload, path, partial(fit_value, value))
    return payload


class HexBytes(BaseModel):
    """Bytes, as hexadecimal digits."""

    model_config = _STRICT
    hex: Annotated[str, Field(pattern=r"^([0-9a-fA-F]{2})*$")]


class RawMutation(BaseModel):
    """One entry of `mutations`: fields that are changed together."""

    model_config = _STRICT
    set: Annotated[dict[str, bool | int | float | str | HexBytes], Field(min_length=1)]
    """New values by field path; a text is a formula over the message as it was before."""
    reason: Annotated[str, Field(min_length=1)]
    """Why this is worth trying."""


class RawMessage(BaseModel):
    """One `[[message]]`: mutations of messages of a type, wherever such a one stands."""

    model_config = _STRICT
    type: str | Annotated[list[str], Field(min_length=1)]
    """Type of the messages, or several that have the same fields."""
    mutations: Annotated[list[RawMutation], Field(min_length=1)]
    consistent: str = ""
    """A formula that is true of sound messages, and false of mutated ones."""
    opt_in: bool = False
    """Whether they are tried only on fields that `include` in riot.toml names."""


def read_mutations(raw: RawMessage, *, where: str, own: bool) -> Iterator[Mutation]:
    """Yield the mutations of a `[[message]]`, one for each of its types.

    Raises:
        ConfigError: A path or formula does not parse.
    """
    if raw.consistent:
        with located(f"{where}.consistent"):
            parse_formula(raw.consistent)
    for number, each in enumerate(raw.mutations):
        place = f"{where}.mutations[{number}]"
        with located(place):
            for path in each.set:
                parse_selector(f"x:{path}")
            changes = tuple((path, _value(value)) for path, value in each.set.items())
        for name in [raw.type] if isinstance(raw.type, str) else raw.type:
            yield Mutation(name, changes, each.reason, raw.consistent, raw.opt_in, where, own)


def _value(value: float | str | HexBytes) -> Scalar | Formula:
    if isinstance(value, HexBytes):
        return bytes.fromhex(value.hex)
    if not isinstance(value, str):
        return value
    literal = parse_formula(value).literal
    return Formula(value) if literal is None else literal
