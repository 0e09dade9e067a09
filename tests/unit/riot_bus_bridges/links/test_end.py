"""The other end of a link: what is sent together, and in which order."""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.zenoh.session import wait_until
from riot_bus_bridges.links.udp import _alike
from tests.unit.riot_bus_bridges.links.hosts import WAIT_S, KeepingHost, address_of, udp_socket

FRAME = b"\xfd\x01\x00\x00\x00\x01\x01\x00\x00\x00\x01\x00\x00"


def on_loop(host: KeepingHost, do: Any) -> None:
    """Do something on the loop's thread, and wait until it is done."""
    done = threading.Event()

    def act() -> None:
        do()
        host.loop.at_end(done.set)  # what is added last is done first, so what `do` has added may still wait

    host.loop.later(0, act)
    assert done.wait(WAIT_S)


@given(st.lists(st.integers(1, 4), min_size=1, max_size=200), st.data())
def test_packets_of_one_call_have_one_length_but_for_a_shorter_last_one(sizes: list[int], data: st.DataObject) -> None:
    frames = [bytes(size) for size in sizes]
    at = data.draw(st.integers(0, len(frames) - 1))
    stop = _alike(frames, at)
    assert at < stop <= min(len(frames), at + 64)
    assert set(sizes[at : stop - 1]) <= {sizes[at]}
    assert sizes[stop - 1] <= sizes[at]


@pytest.mark.parametrize("together", [True, False])
@pytest.mark.parametrize("cuts", [True, False])
@pytest.mark.parametrize("kind", ["udpin", "udpout"])
def test_frames_that_a_handler_sends_arrive_one_by_one_in_their_order(kind: str, *, cuts: bool, together: bool) -> None:
    sent = [bytes([number % 251]) * (1 + number * number % 7 * (number > 50)) for number in range(150)]
    with KeepingHost() as host, udp_socket() as other:
        link: Any = host.open("udpin:127.0.0.1:0" if kind == "udpin" else f"udpout:127.0.0.1:{other.getsockname()[1]}")
        if kind == "udpin":
            other.sendto(FRAME, address_of(link.where))
        assert host.wait(lambda: len(host.ends) == 1)
        link._cuts = cuts
        (end,) = host.ends

        def send() -> None:
            end.send(sent[0])
            if together:
                end.send_all(sent[1:60])
                end.send_all(sent[60:149])
            for each in sent[149:] if together else sent[1:]:
                end.send(each)

        on_loop(host, send)
        assert [other.recv(100) for _ in sent] == sent
        assert wait_until(lambda: end.out == len(sent), WAIT_S)
        assert end.lost == 0


def test_what_another_thread_sends_does_not_overtake() -> None:
    with KeepingHost() as host, udp_socket() as other:
        host.open(f"udpout:127.0.0.1:{other.getsockname()[1]}")
        (end,) = host.ends

        def both() -> None:
            end.send(b"first")
            thread = threading.Thread(target=end.send, args=(b"second",))
            thread.start()
            thread.join()
            end.send_all([b"third", b"fourth"])
            thread = threading.Thread(target=end.send_all, args=([b"fifth", b"sixth"],))
            thread.start()
            thread.join()

        on_loop(host, both)
        sent = [b"first", b"second", b"third", b"fourth", b"fifth", b"sixth"]
        assert [other.recv(100) for _ in sent] == sent


@pytest.mark.parametrize("error", [errno.EIO, errno.EAGAIN])
def test_a_system_that_cannot_cut_gets_single_packets(error: int) -> None:
    """Another socket stands for the system's: no device here lacks the ability."""

    class Refusing:
        def __init__(self, made: socket.socket) -> None:
            self._made = made

        def sendmsg(self, frames: Sequence[bytes], *more: object) -> int:
            raise OSError(error, os.strerror(error))

        def __getattr__(self, name: str) -> Any:
            return getattr(self._made, name)

    with KeepingHost() as host, udp_socket() as other:
        link: Any = host.open(f"udpout:127.0.0.1:{other.getsockname()[1]}")
        link._socket = Refusing(link._socket)
        (end,) = host.ends
        on_loop(host, lambda: [end.send(each) for each in (b"1", b"2", b"3")])
        assert [other.recv(100) for _ in range(3)] == [b"1", b"2", b"3"]
        assert link._cuts is (error == errno.EAGAIN)


def test_streams_take_many_frames_at_once() -> None:
    with KeepingHost() as host, socket.create_server(("127.0.0.1", 0)) as server:
        host.open(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        made, _ = server.accept()
        with made:
            made.settimeout(WAIT_S)
            assert host.wait(lambda: len(host.ends) == 1)
            (end,) = host.ends
            on_loop(host, lambda: [end.send(b"%03d" % number) for number in range(200)])
            data = b""
            while len(data) < 600:
                data += made.recv(1000)
            assert data == b"".join(b"%03d" % number for number in range(200))
            assert wait_until(lambda: end.out == 200, WAIT_S)
