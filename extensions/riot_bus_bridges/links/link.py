"""Links, which carry frames between their ends and a host, and what they need of that host."""

from __future__ import annotations

import errno
import socket
import threading
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_bridges.links.end import Batching, End
from riot_bus_mavlink.frame import Framer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus_bridges.links.loop import Loop, Timer
    from riot_bus_bridges.mavlink.url import LinkSpec


class Host(Protocol):
    """Owner of links, to which they report ends, frames and problems."""

    loop: Loop
    crc_extra: Callable[[int], int | None]

    def join(self, end: End) -> None:
        """Take a new end of a link, which gets frames from now on."""

    def leave(self, end: End) -> None:
        """Forget an end that is gone."""

    def receive(self, end: End, packets: Sequence[bytes]) -> None:
        """Take packets, or pieces of a stream, in the order in which they came."""

    def warn(self, spec: LinkSpec, text: str) -> None:
        """Report a problem."""


class Link:
    """A link that is open, or trying to be."""

    idle: ClassVar[str] = "listening"
    busy: ClassVar[str] = "connected"

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        self.spec, self.where = spec, spec.where
        self._host = host
        self._ends: list[End] = []

    @property
    def state(self) -> str:
        """Return `idle` or `busy`."""
        return self.busy if self._ends else self.idle

    def dropped(self) -> int:
        """Return how many packets the operating system has dropped because they were not taken in time.

        It is 0 where the system drops nothing (TCP, files) or does not tell it (devices).
        """
        return 0

    def close(self) -> None:
        """Close the link; its ends leave."""
        for end in list(self._ends):
            self.leave(end)

    def join(
        self,
        address: str,
        write: Callable[[bytes], bool],
        write_all: Callable[[Sequence[bytes]], int] | None = None,
    ) -> End:
        """Add an end, to which the host sends frames from now on.

        Args:
            write_all: Sends several frames in their order; returns how many went out, or will. Frames that one handler
                sends are then collected for it; None to send each frame by itself.
        """
        batching = None if write_all is None else Batching(self._host.loop, write_all)
        end = End(self.spec, address, Framer(self._host.crc_extra), write, batching)
        self._ends.append(end)
        self._host.join(end)
        return end

    def leave(self, end: End) -> None:
        """Forget an end that is gone."""
        self._ends.remove(end)
        self._host.leave(end)


class RetriedLink(Link, ABC):
    """Link with one end, which is opened again, after a while, whenever it is lost or cannot be opened.

    The `_try` of a subclass opens it, now or later, on the loop's thread; if it cannot, it calls `_again`.
    """

    idle = "connecting"
    retry: ClassVar[float]

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._timer: Timer | None = None
        self._last_reason = ""
        self._closed = False

    def close(self) -> None:
        """Close the link; its end leaves."""
        self._closed = True
        self._cancel_attempt()
        super().close()

    @abstractmethod
    def _try(self) -> None:
        """Open the link's end."""

    def _again(self, why: str | OSError) -> None:
        """Try again later; report the same reason only once."""
        self._cancel_attempt()
        if self._closed:
            return
        why = reason(why) if isinstance(why, OSError) else why
        if why != self._last_reason:
            self._last_reason = why
            self._host.warn(self.spec, f"{why}; it is tried again")
        self._timer = self._host.loop.later(self.retry, self._try)

    def _cancel_attempt(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


Place = tuple[int, tuple[Any, ...]]
"""Address family and address."""


def place_of(host: str, port: int, kind: int, *, flags: int = 0) -> Place:
    """Return the address of a host; waits while its name is looked up.

    For a name with IPv4 and IPv6 addresses, such as `localhost`, IPv4 is taken: other MAVLink programs listen there.

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


def cannot_listen(spec: LinkSpec, error: OSError) -> EnvironmentFaultError:
    """Return an error that says why a link cannot listen."""
    hint = "choose another port, or end the program that has it" if error.errno == errno.EADDRINUSE else None
    return EnvironmentFaultError(f"cannot listen: {reason(error)}", where=f"{spec.name} ({spec.where})", hint=hint)


def reason(error: OSError) -> str:
    """Return the system's error message."""
    return error.strerror or str(error)
