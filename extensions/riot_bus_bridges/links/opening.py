"""Opens a link of any kind."""

from __future__ import annotations

from collections.abc import Callable

from riot_bus_bridges.links.link import Host, Link
from riot_bus_bridges.links.logs import TelemetryLogSink, TelemetryLogSource
from riot_bus_bridges.links.stream import SerialLink
from riot_bus_bridges.links.tcp import TcpClient, TcpServer
from riot_bus_bridges.links.udp import UdpClient, UdpServer
from riot_bus_bridges.mavlink.url import LinkKind, LinkSpec

_LINKS: dict[LinkKind, Callable[[LinkSpec, Host], Link]] = {
    LinkKind.UDP_SERVER: UdpServer,
    LinkKind.UDP_CLIENT: UdpClient,
    LinkKind.TCP_SERVER: TcpServer,
    LinkKind.TCP_CLIENT: TcpClient,
    LinkKind.SERIAL: SerialLink,
    LinkKind.LOG_READER: TelemetryLogSource,
    LinkKind.LOG_WRITER: TelemetryLogSink,
}


def open_link(spec: LinkSpec, host: Host) -> Link:
    """Open a link; raises EnvironmentFaultError if it cannot, or MissingExtraError if a package is missing."""
    return _LINKS[spec.kind](spec, host)
