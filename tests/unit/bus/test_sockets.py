"""Hanging up Unix sockets of this process."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from riot_bus.bus.sockets import hang_up

if TYPE_CHECKING:
    from pathlib import Path


def test_what_was_accepted_is_hung_up_and_who_listens_goes_on(tmp_path: Path) -> None:
    with ExitStack() as stack:

        def connected(listener: socket.socket) -> socket.socket:
            end = stack.enter_context(socket.socket(socket.AF_UNIX))
            end.settimeout(5)
            end.connect(listener.getsockname())
            stack.enter_context(listener.accept()[0])
            return end

        listeners = []
        for name in ("meant", "other"):
            listener = stack.enter_context(socket.socket(socket.AF_UNIX))
            listener.bind(str(tmp_path / name))
            listener.listen()
            listener.settimeout(5)
            listeners.append(listener)
        meant, other = [connected(each) for each in listeners]
        hang_up({str(tmp_path / "meant"), str(tmp_path / "nobody")})
        assert meant.recv(1) == b""
        other.settimeout(0)
        with pytest.raises(BlockingIOError):
            other.recv(1)
        connected(listeners[0]).settimeout(0)
