"""Descriptions of known types and the fields of their messages."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches

from riot_bus.types.capabilities import DescribesFields
from riot_bus.types.fields import FieldType
from riot_bus.types.model import MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean


@dataclass(frozen=True, slots=True)
class TypeListing:
    """A type and the fields of its messages.

    Attributes:
        fields: Fields in payload order; empty if only payloads show them.
        problem: Reason why the fields are unknown although the type describes them.
    """

    name: str
    encoding: str
    fields: tuple[FieldType, ...] = ()
    problem: str = ""


def describe(kind: MessageType) -> TypeListing:
    """Return a type with the fields that it describes."""
    if not isinstance(kind, DescribesFields):
        return TypeListing(kind.name, kind.encoding)
    try:
        return TypeListing(kind.name, kind.encoding, tuple(kind.fields()))
    except PayloadError as error:
        return TypeListing(kind.name, kind.encoding, problem=error.message)


def describe_named(name: str, registry: TypeRegistry) -> TypeListing:
    """Return the fields of a known type; a short name such as `Odometry` is enough if only one package has it.

    The case of a short name may differ if only one type matches it then.

    Raises:
        ConfigError: The type is unknown.
    """
    known = registry.type_names()
    short = [each for each in known if _short(each) == _short(name)]
    same = [each for each in short if _last(each) == _last(name)]
    short = same if len(same) == 1 else short
    for candidate in (name, *(short if len(short) == 1 and name.isidentifier() else ())):
        found = registry.type_named(candidate)
        if found is not None:
            return describe(found)
    alike = set(get_close_matches(_last(name), map(_last, known)))
    near = short or [each for each in known if _last(each) in alike]
    hint = f"did you mean {' or '.join(map(repr, near[:3]))}?" if near else did_you_mean(name, known)
    raise ConfigError(f"unknown message type {name!r}", hint=hint)


def _short(name: str) -> str:
    return _last(name).lower()


def _last(name: str) -> str:
    return re.split(r"[/.]", name)[-1]
