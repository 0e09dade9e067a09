"""The Unix sockets over which the routers of this process are linked; Zenoh has no calls for them."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator, Set


def hang_up(accepted: Set[str] = frozenset(), connected: Set[str] = frozenset()) -> None:
    """Shut down ends of connections in this process for receiving, except for data in transit.

    Args:
        accepted: Paths of sockets on which these ends were accepted.
        connected: Paths of sockets to which these ends have connected.
    """
    import socket

    for end in _ends(accepted | connected):
        if end.getsockname() in accepted or end.getpeername() in connected:
            end.shutdown(socket.SHUT_RD)


def widen(paths: Set[str]) -> None:
    """Let connections hold several of Zenoh's full batches (64 KiB), as TCP does; Unix sockets hold three at first."""
    import socket

    for end in _ends(paths):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)  # at most net.core.wmem_max


def _ends(paths: Set[str]) -> Iterator[socket.socket]:
    """Yield duplicates of this process's ends of connections, each open until the next one."""
    import socket

    for name in os.listdir("/dev/fd"):
        with suppress(OSError):  # others close theirs meanwhile, and what listens has no peer
            number = int(name)
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                with socket.socket(fileno=os.dup(number)) as end:
                    if {end.getpeername(), end.getsockname()} & paths:
                        yield end
