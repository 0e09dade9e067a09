"""MAVLink for riot_bus: frames, dialects, types of messages, signing, tlogs. For scripts: the names below."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus_mavlink.dialect import load_dialect as load_dialect
    from riot_bus_mavlink.frame import Framer as Framer
    from riot_bus_mavlink.message_type import MavlinkType as MavlinkType

_PLACES = {"Framer": "frame", "MavlinkType": "message_type", "load_dialect": "dialect"}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
