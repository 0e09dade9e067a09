"""Joins other middleware to segments: ROS 2 over DDS, MAVLink, `riot ros-test`. For authors: `Bridge`, `BridgeHost`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus_bridges.bridging import Bridge as Bridge
    from riot_bus_bridges.cli.bridge import BridgeHost as BridgeHost


def __getattr__(name: str) -> Any:
    if name not in ("Bridge", "BridgeHost"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from riot_bus_bridges import bridging
    from riot_bus_bridges.cli import bridge

    return bridging.Bridge if name == "Bridge" else bridge.BridgeHost
