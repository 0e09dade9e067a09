"""What a node says of its types: replies of `<node>/get_type_description`, for tests."""

from __future__ import annotations

from typing import Any

from riot_bus_ros2.definitions import Field, fields_of
from riot_bus_ros2.hashes import BASE_IDS, BOUNDED, COLLECTIONS, NESTED, PLACEHOLDER
from riot_bus_ros2.live import SERVICE
from riot_bus_ros2.store import TypeStore
from tests.ros2_messages import encode


def description(name: str, store: TypeStore) -> dict[str, Any]:
    """A node's description; rosidl gives messages without fields a placeholder."""
    placeholder = {"name": PLACEHOLDER, "type": {"type_id": BASE_IDS["uint8"]}}
    parts = [
        {"type_name": each, "fields": [_field(one) for one in fields_of(definition)] or [placeholder]}
        for each, definition in store.closure(name).items()
    ]
    return {"type_description": parts[0], "referenced_type_descriptions": parts[1:]}


def reply(name: str, store: TypeStore, **changes: Any) -> bytes:
    """The payload of a reply."""
    document = {"successful": True, "failure_reason": "", "type_description": description(name, store)}
    return encode(f"{SERVICE}_Response", document | changes)


def _field(field: Field) -> dict[str, Any]:
    base = NESTED if field.is_message else (BOUNDED if field.most_bytes else BASE_IDS)[field.content]
    kind = "array" if field.length is not None else "bounded" if field.most else "sequence"
    return {
        "name": field.name,
        "type": {
            "type_id": base + (COLLECTIONS[kind] if field.is_array else 0),
            "capacity": field.length or field.most,
            "string_capacity": field.most_bytes,
            "nested_type_name": field.content if field.is_message else "",
        },
    }
