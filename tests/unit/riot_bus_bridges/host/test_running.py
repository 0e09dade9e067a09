from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from riot_bus.control.terminal import Foreground
from riot_bus_bridges.bridging import Bridge
from riot_bus_bridges.host.running import run_bridge
from riot_bus_bridges.mavlink.bridge import MavlinkBridge
from riot_bus_bridges.mavlink.options import MavlinkBridgeOptions


class Short(Bridge):
    """A bridge that ends at once, and listens to the network."""

    listens = ("udp/0.0.0.0:14550", "tcp/127.0.0.1:5760")

    def open(self, stack: ExitStack) -> None:
        self.ended.set()

    def status(self) -> dict[str, Any]:
        return {}

    def ready(self) -> str:
        return "ready"

    def summary(self) -> list[str]:
        return ["done"]


def test_links_that_are_open_to_the_network_are_warned_of_before_they_open() -> None:
    said: list[str] = []
    assert run_bridge(Short(), Foreground(said.append, said.append)) == 0
    assert said[0].startswith("warning: a link listens on udp/0.0.0.0:14550: any host that reaches it")
    assert [line for line in said if "listens" in line] == said[:1]


def test_links_of_mavlink_that_listen_are_told() -> None:
    links = ("udpin:0.0.0.0:14550", "tcpin:[::1]:5760", "udpout:127.0.0.1:14551", "tcp:127.0.0.1:5761")
    bridge = MavlinkBridge({}, MavlinkBridgeOptions(links=links))
    assert list(bridge.listens) == ["udp/0.0.0.0:14550", "tcp/[::1]:5760"]
    bridge.loop.close()
