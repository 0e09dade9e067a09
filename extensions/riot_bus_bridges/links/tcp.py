"""TCP links."""

from __future__ import annotations

import errno
import os
import socket

from riot_bus_bridges.links.link import Host, Link, Place, cannot_listen, look_up, place_of, text_of
from riot_bus_bridges.links.loop import READ, WRITE
from riot_bus_bridges.links.stream import Stream, StreamClient
from riot_bus_bridges.mavlink.url import LinkSpec

_MOST_CLIENTS = 64  # a guess: any host may connect; each takes a descriptor and is sent frames
_PROBES = 4  # with the default of 30 s, one each 6 s: one lost probe ends nothing
_LONGEST_PROBE_S = 32767  # limit of Linux


def _configured(made: socket.socket, silence: float) -> socket.socket:
    """Return a connection that ends when the other end is silent, even to TCP itself, for `silence` seconds."""
    made.settimeout(0)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    probe = max(1, min(_LONGEST_PROBE_S, round(silence / (_PROBES + 1))))
    for option, value in (
        (socket.TCP_NODELAY, 1),
        (socket.TCP_KEEPIDLE, probe),
        (socket.TCP_KEEPINTVL, probe),
        (socket.TCP_KEEPCNT, _PROBES),
        (socket.TCP_USER_TIMEOUT, round(min(silence, _LONGEST_PROBE_S) * 1000)),
    ):
        made.setsockopt(socket.IPPROTO_TCP, option, value)
    return made


class TcpServer(Link):
    """Listens for clients, each of which becomes an end of the link."""

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._streams: list[Stream] = []
        try:
            family, address = place_of(spec.host, spec.port, socket.SOCK_STREAM)
            both = family == socket.AF_INET6 and spec.host == "::"  # as `udpin:[::]:PORT` is
            self._listener = socket.create_server(address[:2], family=family, dualstack_ipv6=both)
        except OSError as error:
            raise cannot_listen(spec, error) from error
        self.where = text_of(self._listener.getsockname())
        self._listener.settimeout(0)
        host.loop.watch(self._listener.fileno(), self._accept)

    def close(self) -> None:
        """Close the link and its streams."""
        self._host.loop.forget(self._listener.fileno())
        self._listener.close()
        for stream in self._streams:
            stream.close()
        super().close()

    def _accept(self, events: int) -> None:
        try:
            made, address = self._listener.accept()
        except OSError:  # the client has gone again
            return
        if len(self._streams) >= _MOST_CLIENTS:
            made.close()
            self._host.warn(self.spec, f"more than {_MOST_CLIENTS} clients are refused")
            return
        transport = _configured(made, self.spec.silence)
        self._streams.append(
            Stream(self, self._host, address=text_of(address), transport=transport, gone=self._streams.remove)
        )


class TcpClient(StreamClient):
    """Connects, and reconnects when the connection is lost."""

    lost, retry = "disconnected", 0.5

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._trying: socket.socket | None = None
        self._try()

    def _try(self) -> None:
        look_up(self._host.loop, self.spec, socket.SOCK_STREAM, found=self._connect, failed=self._again)

    def _connect(self, place: Place) -> None:
        if self._closed:
            return
        family, address = place
        try:
            made = self._trying = socket.socket(family, socket.SOCK_STREAM)
            made.settimeout(0)
            code = made.connect_ex(address)
        except OSError as error:
            self._again(error)
            return
        if code not in (0, errno.EINPROGRESS):
            self._again(os.strerror(code))
            return
        self._host.loop.watch(made.fileno(), self._see, READ | WRITE)
        # A lost SYN is repeated after 1 and 3 s; Linux would wait 2 minutes.
        self._timer = self._host.loop.later(5.0, lambda: self._again("no answer"))

    def _see(self, events: int) -> None:
        made = self._trying
        if made is None:
            return
        code = made.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            self._again(os.strerror(code))
            return
        if self._timer is not None:
            self._timer.cancel()
        self._host.loop.forget(made.fileno())
        self._trying = None
        self._opened(_configured(made, self.spec.silence))

    def _cancel_attempt(self) -> None:
        super()._cancel_attempt()
        if self._trying is not None:
            if self._trying.fileno() >= 0:
                self._host.loop.forget(self._trying.fileno())
            self._trying.close()
            self._trying = None
