"""The Unix sockets over which the routers of this process are linked; Zenoh has no calls for them."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator, Set

__all__ = ["hang_up", "narrow"]

_SEND_BUFFER = 16 << 10  # Linux doubles it


def hang_up(paths: Set[str]) -> None:
    """Shut down the connections that this process has accepted on sockets."""
    import socket

    for end in _ends(paths):
        if end.getsockname() in paths:
            end.shutdown(socket.SHUT_RDWR)


def narrow(paths: Set[str]) -> None:
    """Make the send buffers of connections smaller than one of Zenoh's full batches (64 KiB).

    All routers of a process share Tokio's threads. After 128 reads in a row, Tokio 1.53 sets a task aside until its
    thread has nothing else to do, and no other thread may take it. If that thread then takes up a link that waits for
    room towards the task that was set aside, both wait until Zenoh closes their links. Whoever reads from a small
    buffer finds it empty before.

    Args:
        paths: Of the sockets; both ends of their connections are in this process.
    """
    import socket

    for end in _ends(paths):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)


def _ends(paths: Set[str]) -> Iterator[socket.socket]:
    """Yield duplicates of this process's ends of connections, each open while it is looked at."""
    import socket

    for name in os.listdir("/dev/fd"):
        with suppress(OSError):  # others close theirs meanwhile, and what listens has no peer
            number = int(name)
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                with socket.socket(fileno=os.dup(number)) as end:
                    if {end.getpeername(), end.getsockname()} & paths:
                        yield end
