"""Random ROS 2 messages as plain documents, and what an independent codec (mcap-ros2-support) makes of them."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

from mcap.records import Schema
from mcap_ros2 import _dynamic as mcap_ros2  # the package has no public encoder
from mcap_ros2.decoder import DecoderFactory

from riot_bus_ros2.definitions import Field
from riot_bus_ros2.hashes import PLACEHOLDER
from riot_bus_ros2.store import TypeStore

STORE = TypeStore()
NAMES = [name for name in STORE.names() if name.split("/")[1] == "msg"]
"""All types of a distribution."""
COMMON = [
    name
    for name in NAMES
    if name.startswith(
        (
            "actionlib_msgs/", "builtin_interfaces/", "diagnostic_msgs/", "geometry_msgs/", "nav_msgs/", "sensor_msgs/",
            "shape_msgs/", "std_msgs/", "stereo_msgs/", "tf2_msgs/", "trajectory_msgs/", "visualization_msgs/",
        )
    )
]  # fmt: skip
"""Those of common_interfaces."""


def random_document(name: str, rng: random.Random, *, longest: int = 4, store: TypeStore = STORE) -> dict[str, Any]:
    """Return a message as nested dictionaries and lists."""
    return {
        field.name: _random_field(field, rng, longest, store)
        for field in store.fields(name)
        if field.name != PLACEHOLDER
    }


def leaves(name: str, document: dict[str, Any], path: str = "", store: TypeStore = STORE) -> Iterator[tuple[str, Any]]:
    """Yield all paths and values in payload order, as `CdrType.leaves` has to list them."""
    for field in store.fields(name):
        if field.name == PLACEHOLDER:
            continue
        here = f"{path}.{field.name}" if path else field.name
        value = document[field.name]
        if not field.is_array:
            yield from leaves(field.content, value, here, store) if field.is_message else [(here, value)]
            continue
        if field.length is None:
            yield f"len({here})", len(value)
        for index, each in enumerate(value):
            place = f"{here}[{index}]"
            yield from leaves(field.content, each, place, store) if field.is_message else [(place, each)]


def encode(name: str, document: dict[str, Any], store: TypeStore = STORE) -> bytes:
    """Return the payload as mcap-ros2-support writes it."""
    return bytes(_encoder(store.schema(name).data.decode())(document))


def decode(name: str, payload: bytes) -> dict[str, Any]:
    """Return the document as mcap-ros2-support reads it; little-endian alone."""
    found: dict[str, Any] = _document(_decoder(name)(payload))
    return found


def with_value(document: Any, steps: tuple[str | int, ...], value: Any) -> None:
    """Set a scalar in a document."""
    *way, last = steps
    for step in way:
        document = document[step]
    document[last] = value


def value_at(document: Any, steps: tuple[str | int, ...]) -> Any:
    """Return what is at a path."""
    for step in steps:
        document = document[step]
    return document


def random_base(name: str, rng: random.Random, most: int = 0) -> Any:
    """Return a value of a base type, the odd ones often."""
    if name == "string":
        text = "".join(rng.choices("abcé \n", k=rng.randrange(9)))
        return text.encode()[:most].decode(errors="ignore") if most else text
    if name == "bool":
        return rng.random() < 0.5
    if name.startswith("float"):
        value = rng.choice([rng.uniform(-1e6, 1e6), float("inf"), -0.0, 5e-324, 1e-40])
        return struct.unpack("<f", struct.pack("<f", value))[0] if name == "float32" else value
    bits = {"byte": 8, "char": 7}.get(name) or int(name.lstrip("uint"))  # mcap-ros2-support takes char for int8
    return rng.getrandbits(bits) - (1 << (bits - 1) if name.startswith("int") else 0)


def _random_field(field: Field, rng: random.Random, longest: int, store: TypeStore) -> Any:
    def one() -> Any:
        if field.is_message:
            return random_document(field.content, rng, longest=longest, store=store)
        return random_base(field.content, rng, field.most_bytes)

    if not field.is_array:
        return one()
    length = rng.randrange(min(longest, field.most or longest) + 1) if field.length is None else field.length
    return [one() for _ in range(length)]


@cache
def _encoder(text: str) -> Any:
    # parts of services and actions have an underscore in their names, which this codec does not let pass
    text = re.sub(r"\b(\w+)/(\w+)", lambda match: f"{match[1]}/{match[2].replace('_', '')}", text)
    return mcap_ros2.serialize_dynamic("a/msg/Whole", text)["a/msg/Whole"]


@cache
def _decoder(name: str) -> Any:
    return DecoderFactory().decoder_for("cdr", Schema(1, STORE.schema(name).data, "ros2msg", name))


def _document(value: Any) -> Any:
    if hasattr(value, "__slots__") and hasattr(value, "_type"):
        return {name: _document(getattr(value, name)) for name in value.__slots__}
    return [_document(each) for each in value] if isinstance(value, list | tuple | bytes) else value
