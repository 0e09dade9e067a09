"""The messages nested in a ROS 2 message."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.types.capabilities import MOST_PARTS, MessagePart
from riot_bus.types.model import member_path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from riot_bus_ros2.definitions import Field

__all__ = ["list_parts"]

_DEEPEST = 64  # types of Jazzy are nested up to 6 deep; ends those that contain themselves


def list_parts(name: str, fields_of: Callable[[str], Iterable[Field]]) -> list[MessagePart]:
    """Return a type and all message types in it, outer ones first, `MOST_PARTS` at most.

    Args:
        name: Name of the type.
        fields_of: Returns a type's fields; raises KeyError if it is unknown.

    Raises:
        KeyError: A type is unknown.
    """
    found = [MessagePart("", name)]
    for part in found:  # grows during the loop
        if part.path.count(".") >= _DEEPEST:
            break
        for field in fields_of(part.type_name):
            if field.is_message and len(found) < MOST_PARTS:
                path = member_path(part.path, field.name)
                found.append(MessagePart(f"{path}[*]" if field.is_array else path, field.content))
    return found
