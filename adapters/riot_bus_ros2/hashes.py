"""RIHS01 hashes of types, which are used in rmw_zenoh's keys, in DDS's user data and in bags.

Source: REP 2011 and 2016, and `type_description_interfaces/msg/FieldType`. rosbags has such a function too, but its
version 0.11 is wrong about `char` and lacks `wstring`.
"""

from __future__ import annotations

import json
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from riot_bus_ros2.definitions import fields_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus_ros2.definitions import Definition, Field

PLACEHOLDER = "structure_needs_at_least_one_member"
"""The field that rosidl gives to messages without any."""
NESTED = 1
BASE_IDS = {
    "int8": 2, "uint8": 3, "char": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9,
    "float32": 10, "float64": 11, "float128": 12, "wchar": 14, "bool": 15, "byte": 16, "string": 17, "wstring": 18,
}  # fmt: skip
"""Numbers of the base types; the `char` of .msg files is a uint8 to rosidl."""
BOUNDED = {"string": 21, "wstring": 22}
COLLECTIONS = {"array": 48, "bounded": 96, "sequence": 144}
"""What is added to a type's number for arrays, and for sequences with and without an upper bound."""


def type_hash(name: str, closure: Mapping[str, Definition]) -> str:
    """Return the hash of a type.

    Args:
        closure: Its definition and those of all types in it, and no others.

    Raises:
        KeyError: A field's base type does not exist in ROS 2.
    """
    others = [_described(other, closure[other]) for other in sorted(closure) if other != name]
    description = {"type_description": _described(name, closure[name]), "referenced_type_descriptions": others}
    return f"RIHS01_{sha256(json.dumps(description).encode()).hexdigest()}"


def _described(name: str, definition: Definition) -> dict[str, Any]:
    fields = [_field(field) for field in fields_of(definition)]
    return {"type_name": name, "fields": fields or [_entry(PLACEHOLDER, BASE_IDS["uint8"])]}


def _field(field: Field) -> dict[str, Any]:
    number = NESTED if field.is_message else BASE_IDS[field.content]
    if field.most_bytes:
        number = BOUNDED[field.content]
    if field.is_array:
        kind = "array" if field.length is not None else "bounded" if field.most else "sequence"
        number += COLLECTIONS[kind]
    nested = field.content if field.is_message else ""
    return _entry(field.name, number, field.length or field.most, field.most_bytes, nested)


def _entry(name: str, number: int, capacity: int = 0, string_capacity: int = 0, nested: str = "") -> dict[str, Any]:
    kind = {"type_id": number, "capacity": capacity, "string_capacity": string_capacity, "nested_type_name": nested}
    return {"name": name, "type": kind}
