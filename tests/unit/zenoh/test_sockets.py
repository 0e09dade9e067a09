"""Hanging up Unix sockets of this process."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from riot_bus.zenoh.sockets import hang_up

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("accepted", [True, False])
def test_one_end_is_hung_up_and_who_listens_goes_on(tmp_path: Path, *, accepted: bool) -> None:
    with ExitStack() as stack:

        def connected(listener: socket.socket) -> list[socket.socket]:
            end = stack.enter_context(socket.socket(socket.AF_UNIX))
            end.settimeout(5)
            end.connect(listener.getsockname())
            other = stack.enter_context(listener.accept()[0])
            end.sendall(b"under way")
            other.sendall(b"under way")
            return [other, end] if accepted else [end, other]

        listeners = []
        for name in ("meant", "other"):
            listener = stack.enter_context(socket.socket(socket.AF_UNIX))
            listener.bind(str(tmp_path / name))
            listener.listen()
            listener.settimeout(5)
            listeners.append(listener)
        meant, other = [connected(each) for each in listeners]
        paths = {str(tmp_path / "meant"), str(tmp_path / "nobody")}
        hang_up(**{"accepted" if accepted else "connected": paths})
        assert meant[0].recv(100) == b"under way"
        assert meant[0].recv(100) == b""
        meant[0].sendall(b", and more")
        assert meant[1].recv(100) == b"under way, and more"
        with pytest.raises(BrokenPipeError):
            meant[1].sendall(b"nobody reads this")
        for end in (*other, *connected(listeners[0])):
            end.setblocking(False)
            assert end.recv(100) == b"under way"
            with pytest.raises(BlockingIOError):
                end.recv(1)
