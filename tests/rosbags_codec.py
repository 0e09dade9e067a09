"""ROS 2 messages as rosbags encodes them."""

from __future__ import annotations

from functools import cache
from typing import Any

from rosbags.typesys.store import Typestore

from riot_bus_ros2.store import TypeStore


def encoded(message: Any, name: str, store: TypeStore, *, little_endian: bool = True) -> bytes:
    """Return the payload of a message object of rosbags, such as `TypeStore.decode` returns."""
    return bytes(_typestore(store, name).serialize_cdr(message, name, little_endian=little_endian))


@cache
def _typestore(store: TypeStore, name: str) -> Typestore:
    found = Typestore()
    found.register(store.closure(name))
    return found
