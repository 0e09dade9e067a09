"""The fields of a ROS 2 type, derived from its layout."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from riot_bus.types.fields import MOST_FIELDS, FieldType
from riot_bus.types.model import member_path
from riot_bus_ros2.cdr_layout import Array, Node, Opaque, Struct, Text
from riot_bus_ros2.cdr_units import UNITS
from riot_bus_ros2.hashes import PLACEHOLDER

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["list_fields"]


def list_fields(root: Struct) -> list[FieldType]:
    """List the scalar fields, and the elements and lengths of arrays, in payload order.

    Raises:
        PayloadError: The type has opaque parts.
    """
    return list(islice(_fields(root, "", 0, "", {}), MOST_FIELDS))


def _fields(node: Node, path: str, length: int, unit: str, known: dict[int, bool]) -> Iterator[FieldType]:
    if isinstance(node, Struct):
        units = UNITS.get(node.name, {})
        for name, each in node.fields.items():
            if name != PLACEHOLDER and _has_fields(each, known):
                yield from _fields(each, member_path(path, name), length, units.get(name, unit), known)
    elif isinstance(node, Array):
        if node.length is None:
            yield FieldType(f"len({path})", "uint32", high=node.most or None)
        if node.length != 0:
            yield from _fields(node.element, f"{path}[*]", node.length or 0, unit, known)
    elif isinstance(node, Opaque):
        raise node.error()
    elif isinstance(node, Text):
        yield FieldType(path, node.type, length, high=node.most or None)
    else:
        yield FieldType(path, node.type, length, unit=unit)


def _has_fields(node: Node, known: dict[int, bool]) -> bool:
    """Return whether there is anything to list, since there may be too many nested empty messages to visit."""
    if isinstance(node, Struct):
        if id(node) not in known:
            known[id(node)] = any(
                name != PLACEHOLDER and _has_fields(each, known) for name, each in node.fields.items()
            )
        return known[id(node)]
    if isinstance(node, Array):
        return node.length is None or (node.length > 0 and _has_fields(node.element, known))
    return True
