"""UDP links."""

from __future__ import annotations

import errno
import ipaddress
import itertools
import os
import socket
import struct
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from riot_bus_bridges.links.end import MOST_PENDING, End
from riot_bus_bridges.links.link import Host, Link, Place, RetriedLink, cannot_listen, look_up, place_of, text_of
from riot_bus_bridges.links.packets import Packets
from riot_bus_bridges.mavlink.url import LinkSpec
from riot_bus_mavlink.frame import V1, V2

_UNICAST_S = 5.0  # after an answer to a broadcast, as in mavlink-router
_SIZE = struct.Struct("=H")
_CANNOT_CUT = {errno.EIO, errno.EINVAL, errno.EMSGSIZE, errno.ENOPROTOOPT, errno.EOPNOTSUPP}


class _UdpLink(Link):
    """Link with a UDP socket."""

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._socket: socket.socket | None = None
        self._packets: Packets | None = None
        self._cuts = True

    def dropped(self) -> int:
        return 0 if self._socket is None else _drops(self._socket)

    def _open(self, family: int, bind: tuple[Any, ...] | None) -> socket.socket:
        made = socket.socket(family, socket.SOCK_DGRAM)
        try:
            made.settimeout(0)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                made.setsockopt(socket.SOL_SOCKET, option, 1 << 22)
            made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            if bind is not None:
                made.bind(bind)
            self._packets = Packets(made)
        except BaseException:
            made.close()
            raise
        self._socket = made
        return made

    def _send(self, data: bytes, address: tuple[Any, ...]) -> bool:
        made = self._socket
        if made is None:
            return False
        try:
            return made.sendto(data, address) == len(data)
        except OSError:  # no room, no route, or no receiver
            return False

    def _send_all(self, frames: Sequence[bytes], address: tuple[Any, ...]) -> int:
        """Send frames, each as a packet; return how many went out."""
        done = at = 0
        while at < len(frames):
            stop = _alike(frames, at) if self._cuts else at + 1
            if stop - at > 1 and self._send_cut(frames[at:stop], address):
                done += stop - at
            else:
                done += sum(self._send(each, address) for each in frames[at:stop])
            at = stop
        return done

    def _send_cut(self, frames: Sequence[bytes], address: tuple[Any, ...]) -> bool:
        """Send frames of one length with one call; return whether they went out."""
        made = self._socket
        if made is None:
            return False
        try:
            # 103 is UDP_SEGMENT: the system cuts data into packets of one size; the last may be shorter.
            made.sendmsg(frames, [(socket.IPPROTO_UDP, 103, _SIZE.pack(len(frames[0])))], 0, address)
        except OSError as error:
            self._cuts = error.errno not in _CANNOT_CUT
            return False
        return True

    def close(self) -> None:
        if self._socket is not None:
            self._host.loop.forget(self._socket.fileno())
            self._socket.close()
            self._socket = self._packets = None
        super().close()


class UdpServer(_UdpLink):
    """Listens, and sends to all addresses that have sent something lately."""

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._by_address: dict[Any, End] = {}
        self._heard: dict[Any, float] = {}
        try:
            family, address = place_of(spec.host, spec.port, socket.SOCK_DGRAM)
            made = self._open(family, address)
        except OSError as error:
            raise cannot_listen(spec, error) from error
        self.where = text_of(made.getsockname())
        host.loop.watch(made.fileno(), self._read)
        self._timer = host.loop.later(spec.silence / 4, self._forget_silent)

    def close(self) -> None:
        """Close the link; its ends leave."""
        self._timer.cancel()
        super().close()
        self._by_address.clear()

    def _read(self, events: int) -> None:
        now = time.monotonic()
        for address, packets in () if self._packets is None else self._packets.receive():
            if self._packets is None:  # closed while packets were handled
                return
            end = self._by_address.get(address)
            if end is None:
                packets = list(itertools.dropwhile(_is_no_frame, packets))
                if not packets:
                    continue
                end = self._add(address)
            self._heard[address] = now
            self._host.receive(end, packets)

    def _add(self, address: Any) -> End:
        if len(self._by_address) >= 64:  # addresses can be forged
            self._drop(min(self._heard, key=self._heard.__getitem__))
        send, send_all = partial(self._send, address=address), partial(self._send_all, address=address)
        end = self._by_address[address] = self.join(text_of(address), send, send_all)
        return end

    def _drop(self, address: Any) -> None:
        self._heard.pop(address, None)
        self.leave(self._by_address.pop(address))

    def _forget_silent(self) -> None:
        limit = time.monotonic() - self.spec.silence
        for address in [each for each, last in self._heard.items() if last < limit]:
            self._drop(address)
        self._timer = self._host.loop.later(self.spec.silence / 4, self._forget_silent)


class UdpClient(_UdpLink, RetriedLink):
    """Sends to an address from the beginning; receives from any address, as pymavlink does.

    If the address is broadcast or multicast, once a peer answers, frames go to it alone until it is silent.
    """

    retry = 1.0  # a guess: finds a new host soon; one lookup per second costs little

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._target: tuple[Any, ...] = ()
        self._many = False
        self._answering: tuple[tuple[Any, ...], float] | None = None
        self._try()

    def _try(self) -> None:
        look_up(self._host.loop, self.spec, socket.SOCK_DGRAM, found=self._begin, failed=self._again)

    def _begin(self, place: Place) -> None:
        if self._closed:
            return
        family, self._target = place
        try:
            made = self._open(family, None)
        except OSError as error:
            self._again(error)
            return
        self._many = _of_many(self._target[0])
        self.join(
            text_of(self._target),
            self._put,
            None if self._many else partial(self._send_all, address=self._target),
        )
        self._host.loop.watch(made.fileno(), self._read)

    def _put(self, data: bytes) -> bool:
        answering = self._answering  # None unless the address is broadcast or multicast
        if answering is not None and time.monotonic() - answering[1] < _UNICAST_S:
            return self._send(data, answering[0])
        return self._send(data, self._target)

    def _read(self, events: int) -> None:
        for address, packets in () if self._packets is None else self._packets.receive():
            if self._many:
                self._answering = (address, time.monotonic())
            for end in self._ends:  # none once it is closed
                self._host.receive(end, packets)


def _alike(frames: Sequence[bytes], at: int) -> int:
    """Return the end index of the frames from `at` on that can be sent with one call."""
    size, most = len(frames[at]), min(len(frames), at + MOST_PENDING)
    stop = at + 1
    while stop < most and len(frames[stop]) == size:
        stop += 1
    return stop + 1 if stop < most and len(frames[stop]) < size else stop


def _is_no_frame(data: bytes) -> bool:
    return not data or data[0] not in (V1, V2)


def _of_many(host: Any) -> bool:
    try:
        address = ipaddress.ip_address(str(host).partition("%")[0])
    except ValueError:
        return False
    return address.is_multicast or (address.version == 4 and address.packed[3] == 255)


def _drops(made: socket.socket) -> int:
    table = "/proc/net/udp6" if made.family == socket.AF_INET6 else "/proc/net/udp"
    inode = str(os.fstat(made.fileno()).st_ino)
    try:
        with open(table, encoding="ascii") as rows:
            for row in rows:
                columns = row.split()
                if len(columns) > 12 and columns[9] == inode:
                    return int(columns[12])
    except (OSError, ValueError):
        pass
    return 0
