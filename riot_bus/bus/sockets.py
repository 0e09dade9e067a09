"""The Unix sockets over which the routers of this process are linked; Zenoh has no calls for them."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Set

__all__ = ["hang_up"]


def hang_up(paths: Set[str]) -> None:
    """Shut down the connections that this process has accepted on sockets."""
    import socket

    for name in os.listdir("/dev/fd"):
        with suppress(OSError):  # others close theirs meanwhile, and what listens has no peer
            number = int(name)
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                with socket.socket(fileno=os.dup(number)) as end:
                    end.getpeername()
                    if end.getsockname() in paths:
                        end.shutdown(socket.SHUT_RDWR)
