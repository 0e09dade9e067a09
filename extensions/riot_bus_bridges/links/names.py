"""Addresses of hosts; names are looked up on a separate thread, since that may take long."""

from __future__ import annotations

import socket
import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_bridges.links.loop import Loop
    from riot_bus_bridges.mavlink.url import LinkSpec

Place = tuple[int, tuple[Any, ...]]
"""Address family and address."""


def place_of(host: str, port: int, kind: int, *, flags: int = 0) -> Place:
    """Return the address of a host; waits while its name is looked up.

    For a name with IPv4 and IPv6 addresses, such as `localhost`, IPv4 is taken: other MAVLink programs listen there.

    Args:
        host: Name or address.
        port: Port of the host.
        kind: Type of the socket, `SOCK_DGRAM` or `SOCK_STREAM`.
        flags: Flags of `getaddrinfo`.

    Raises:
        OSError: The host is not known.
    """
    found = socket.getaddrinfo(host, port, type=kind, flags=flags)
    family, _, _, _, address = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, address


def text_of(address: tuple[Any, ...]) -> str:
    """Return the address of a socket as people write it."""
    host = f"[{address[0]}]" if ":" in str(address[0]) else address[0]
    return f"{host}:{address[1]}"


def look_up(
    loop: Loop, spec: LinkSpec, kind: int, *, found: Callable[[Place], None], failed: Callable[[OSError], None]
) -> None:
    """Report the address of a link's host: at once if it is written as an address, else later, on the loop's thread."""
    try:
        place = place_of(spec.host, spec.port, kind, flags=socket.AI_NUMERICHOST)
    except OSError:
        pass
    else:
        found(place)
        return

    def ask() -> None:
        try:
            place = place_of(spec.host, spec.port, kind)
        except OSError as error:
            reason = error  # the name `error` ends with this block
            loop.later(0.0, lambda: failed(reason))
        else:
            loop.later(0.0, lambda: found(place))

    threading.Thread(target=ask, name="mavlink-name", daemon=True).start()
