"""Which types are known, and what fields their messages have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError, PayloadError, did_you_mean
from riot_bus.types.fields import Described, FieldType

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.types.model import Adapter, MessageType

__all__ = ["TypeListing", "describe", "describe_named", "type_names"]


@dataclass(frozen=True, slots=True)
class TypeListing:
    """A type and the fields of its messages.

    Attributes:
        name: Such as `nav_msgs/msg/Odometry`.
        encoding: Such as `cdr`.
        fields: In payload order; none if only payloads can tell.
        problem: Why there are none, if they should be known.
    """

    name: str
    encoding: str
    fields: tuple[FieldType, ...] = ()
    problem: str = ""


def describe(kind: MessageType) -> TypeListing:
    """Return the fields that a type says it has."""
    if not isinstance(kind, Described):
        return TypeListing(kind.name, kind.encoding)
    try:
        return TypeListing(kind.name, kind.encoding, tuple(kind.fields()))
    except PayloadError as error:
        return TypeListing(kind.name, kind.encoding, problem=error.message)


def type_names(adapters: Iterable[Adapter]) -> list[str]:
    """Return the names of all types that are known, as far as adapters can tell."""
    found = {"json", "msgpack"}
    for adapter in adapters:
        names = getattr(adapter, "type_names", None)
        if callable(names):
            found.update(names())
    return sorted(found)


def describe_named(name: str, adapters: Sequence[Adapter]) -> TypeListing:
    """Return the fields of a type that an adapter knows; `Odometry` will do if only one package has such.

    Raises:
        ConfigError: No adapter knows the type.
    """
    if name in ("json", "msgpack"):
        return TypeListing(name, name)
    known = type_names(adapters)
    short = [each for each in known if each.rpartition("/")[2].lower() == name.rpartition("/")[2].lower()]
    for candidate in (name, *(short if len(short) == 1 and "/" not in name else ())):
        for adapter in adapters:
            found = adapter.type_named(candidate)
            if found is not None:
                return describe(found)
    hint = f"did you mean {' or '.join(map(repr, short[:3]))}?" if short else did_you_mean(name, known)
    raise ConfigError(f"unknown message type {name!r}", hint=hint)
