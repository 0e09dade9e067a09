"""UDP links."""

from __future__ import annotations

import errno
import ipaddress
import itertools
import os
import socket
import struct
import time
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_mavlink.links.end import Batching
from riot_bus_mavlink.links.names import look_up, place_of, text_of
from riot_bus_mavlink.links.packets import Packets

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus_mavlink.bridge.url import LinkSpec
    from riot_bus_mavlink.links.end import End, Host
    from riot_bus_mavlink.links.loop import Timer
    from riot_bus_mavlink.links.names import Place

__all__ = ["UdpClient", "UdpServer"]

_BUFFER = 1 << 22  # asked for; the system may give less
_MOST_PEERS = 64  # a guess: addresses can be forged, and each is sent frames
_RETRY_S = 1.0  # a guess: finds a new host soon; one lookup per second costs little
_UNICAST_S = 5.0  # after an answer to a broadcast, as in mavlink-router
_STARTS = (0xFE, 0xFD)  # first bytes of frames, `V1` and `V2` in frame.py
_DROPS = 12  # column of /proc/net/udp
_UDP_SEGMENT = 103  # linux/udp.h: the system cuts data into packets of one size; the last may be shorter
_MOST_SEGMENTS = 64  # Linux's UDP_MAX_SEGMENTS, in newer versions 128: it refuses more
_SIZE = struct.Struct("=H")
_CANNOT_CUT = {errno.EIO, errno.EINVAL, errno.EMSGSIZE, errno.ENOPROTOOPT, errno.EOPNOTSUPP}


class _UdpLink:
    def __init__(self, spec: LinkSpec, host: Host) -> None:
        self.spec = spec
        self._host = host
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
                made.setsockopt(socket.SOL_SOCKET, option, _BUFFER)
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
            made.sendmsg(frames, [(socket.IPPROTO_UDP, _UDP_SEGMENT, _SIZE.pack(len(frames[0])))], 0, address)
        except OSError as error:
            self._cuts = error.errno not in _CANNOT_CUT
            return False
        return True

    def close(self) -> None:
        if self._socket is not None:
            self._host.loop.forget(self._socket.fileno())
            self._socket.close()
            self._socket = self._packets = None


class UdpServer(_UdpLink):
    """Listens, and sends to all addresses that have sent something lately.

    Args:
        spec: Settings of the link, with the port.
        host: Gets what comes.

    Raises:
        EnvironmentFaultError: It cannot listen there.
    """

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._ends: dict[Any, End] = {}
        self._heard: dict[Any, float] = {}
        try:
            family, address = place_of(spec.host, spec.port, socket.SOCK_DGRAM)
            made = self._open(family, address)
        except OSError as error:
            raise cannot_listen(spec, error) from error
        host.loop.watch(made.fileno(), self._read)
        self._timer = host.loop.later(spec.silence / 4, self._forget_silent)

    @property
    def where(self) -> str:
        """Return where it listens."""
        return self.spec.where if self._socket is None else text_of(self._socket.getsockname())

    @property
    def state(self) -> str:
        """Return how it is."""
        return "connected" if self._ends else "listening"

    def close(self) -> None:
        """Close it."""
        self._timer.cancel()
        super().close()
        for address in list(self._ends):
            self._drop(address)

    def _read(self, events: int) -> None:
        now = time.monotonic()
        for address, packets in () if self._packets is None else self._packets.receive():
            if self._packets is None:  # closed while packets were handled
                return
            end = self._ends.get(address)
            if end is None:
                packets = list(itertools.dropwhile(_is_no_frame, packets))
                if not packets:
                    continue
                end = self._join(address)
            self._heard[address] = now
            self._host.take(end, packets)

    def _join(self, address: Any) -> End:
        if len(self._ends) >= _MOST_PEERS:
            self._drop(min(self._heard, key=self._heard.__getitem__))
        batching = Batching(self._host.loop, lambda frames: self._send_all(frames, address))
        end = self._host.join(self.spec, text_of(address), lambda data: self._send(data, address), batching)
        self._ends[address] = end
        return end

    def _drop(self, address: Any) -> None:
        self._heard.pop(address, None)
        self._host.leave(self._ends.pop(address))

    def _forget_silent(self) -> None:
        limit = time.monotonic() - self.spec.silence
        for address in [each for each, last in self._heard.items() if last < limit]:
            self._drop(address)
        self._timer = self._host.loop.later(self.spec.silence / 4, self._forget_silent)


class UdpClient(_UdpLink):
    """Sends to an address from the beginning; receives from any address, as pymavlink does.

    If the address is broadcast or multicast, once a peer answers, frames go to it alone until it is silent.

    Args:
        spec: Settings of the link, with the other end.
        host: Gets what comes.
    """

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._end: End | None = None
        self._target: tuple[Any, ...] = ()
        self._many = False
        self._answering: tuple[tuple[Any, ...], float] | None = None
        self._timer: Timer | None = None
        self._closed = False
        self._look_up()

    @property
    def where(self) -> str:
        """Return where it sends to."""
        return self.spec.where

    @property
    def state(self) -> str:
        """Return how it is."""
        return "connecting" if self._end is None else "connected"

    def close(self) -> None:
        """Close it."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        super().close()
        if self._end is not None:
            self._host.leave(self._end)
            self._end = None

    def _look_up(self) -> None:
        spec = self.spec
        look_up(self._host.loop, spec.host, spec.port, socket.SOCK_DGRAM, found=self._begin, failed=self._again)

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
        batching = None if self._many else Batching(self._host.loop, partial(self._send_all, address=self._target))
        self._end = self._host.join(self.spec, text_of(self._target), self._put, batching)
        self._host.loop.watch(made.fileno(), self._read)

    def _again(self, error: OSError) -> None:
        if not self._closed:
            self._host.warn(self.spec, f"{reason(error)}; it is tried again")
            self._timer = self._host.loop.later(_RETRY_S, self._look_up)

    def _put(self, data: bytes) -> bool:
        answering = self._answering  # None unless the address is broadcast or multicast
        if answering is not None and time.monotonic() - answering[1] < _UNICAST_S:
            return self._send(data, answering[0])
        return self._send(data, self._target)

    def _read(self, events: int) -> None:
        for address, packets in () if self._packets is None else self._packets.receive():
            if self._many:
                self._answering = (address, time.monotonic())
            if self._end is not None:
                self._host.take(self._end, packets)


def cannot_listen(spec: LinkSpec, error: OSError) -> EnvironmentFaultError:
    """Return an error that says why a link cannot listen."""
    hint = "choose another port, or end who has it" if error.errno == errno.EADDRINUSE else None
    return EnvironmentFaultError(f"cannot listen: {reason(error)}", where=f"{spec.name} ({spec.where})", hint=hint)


def reason(error: OSError) -> str:
    """Return the system's error message."""
    return error.strerror or str(error)


def _alike(frames: Sequence[bytes], at: int) -> int:
    """Return the end index of the frames from `at` on that can be sent with one call."""
    size, most = len(frames[at]), min(len(frames), at + _MOST_SEGMENTS)
    stop = at + 1
    while stop < most and len(frames[stop]) == size:
        stop += 1
    return stop + 1 if stop < most and len(frames[stop]) < size else stop


def _is_no_frame(data: bytes) -> bool:
    return not data or data[0] not in _STARTS


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
                if len(columns) > _DROPS and columns[9] == inode:
                    return int(columns[_DROPS])
    except (OSError, ValueError):
        pass
    return 0
