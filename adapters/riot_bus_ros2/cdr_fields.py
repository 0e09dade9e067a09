"""The fields of a ROS 2 type, derived from its layout, and the messages that it is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import islice

from riot_bus.types.capabilities import MOST_PARTS, MessagePart
from riot_bus.types.fields import MOST_FIELDS, FieldType
from riot_bus.types.model import MAX_DEPTH, member_path
from riot_bus_ros2.cdr_layout import PRIMITIVES, Array, Node, Opaque, Struct, Text
from riot_bus_ros2.common_fields import UNITS
from riot_bus_ros2.definitions import Field
from riot_bus_ros2.hashes import PLACEHOLDER

_MOST_NAMED = 1000  # fields and constants of a message whose values get names: each field is compared with all of these
Constants = Callable[[str], "Sequence[tuple[str, str, object]]"]
"""Function that returns the constants of a type by its name: the name, type and value of each."""


def list_fields(root: Struct, constants: Constants = lambda _: ()) -> list[FieldType]:
    """List the scalar fields, and the elements and lengths of arrays, in payload order.

    Raises:
        PayloadError: The type has opaque parts.
    """
    return list(islice(_Lister(constants).fields(root, FieldType("", "")), MOST_FIELDS))


class _Lister:
    """Lists fields; of each, `like` has the path and what is known of it from outside."""

    def __init__(self, constants: Constants) -> None:
        self._constants = constants

    def fields(self, node: Node, like: FieldType) -> Iterator[FieldType]:
        if isinstance(node, Struct):
            units, constants = UNITS.get(node.name, {}), self._constants(node.name)
            if len(node.fields) + len(constants) > _MOST_NAMED:
                constants = ()
            for name, each in node.fields.items():
                if name != PLACEHOLDER and each.listed:  # else there may be too many to visit
                    names = _names(name, node, constants)
                    path, unit = member_path(like.path, name), units.get(name, like.unit)
                    yield from self.fields(each, replace(like, path=path, unit=unit, names=names))
        elif isinstance(node, Array):
            if node.length is None:
                yield FieldType(f"len({like.path})", "uint32", high=node.most or None)
            if node.length != 0:
                yield from self.fields(node.element, replace(like, path=f"{like.path}[*]", length=node.length or 0))
        elif isinstance(node, Opaque):
            raise node.error()
        elif isinstance(node, Text):
            yield FieldType(like.path, node.type, like.length, high=node.most or None)
        else:
            yield replace(like, type=node.type)


def _names(field: str, node: Struct, constants: Sequence[tuple[str, str, object]]) -> tuple[tuple[int, str], ...]:
    """Return the values of a field that constants of its message name.

    Definitions do not say which constant belongs to which field. By custom its name begins with that of the field
    (STATUS_FIX), or the message has only one field of the constant's type (DiagnosticStatus).
    """
    kind = _type_of(node.fields[field])
    whole = ((value, name, PRIMITIVES.get(type_)) for name, type_, value in constants if isinstance(value, int))
    fitting = [(value, name) for value, name, primitive in whole if primitive and primitive[0] == kind]
    own = [each for each in fitting if each[1].lower().startswith(f"{field}_")]
    alone = sum(_type_of(each) == kind for each in node.fields.values()) == 1
    found = own or (fitting if alone else [])
    return tuple(found) if len(dict(found)) == len(found) else ()


def _type_of(node: Node) -> str:
    return "" if isinstance(node, Struct | Array | Opaque | Text) else node.type


def list_parts(name: str, fields_of: Callable[[str], Iterable[Field]]) -> list[MessagePart]:
    """Return a type and all message types in it, outer ones first, `MOST_PARTS` at most.

    Raises:
        KeyError: A type is unknown.
    """
    inside = cache(lambda name: [field for field in fields_of(name) if field.is_message])
    found = [MessagePart("", name)]
    for part in found:  # grows during the loop
        if part.path.count(".") >= MAX_DEPTH:  # it contains itself
            break
        for field in inside(part.type_name)[: MOST_PARTS - len(found)]:
            path = member_path(part.path, field.name)
            found.append(MessagePart(f"{path}[*]" if field.is_array else path, field.content))
    return found
