"""Serial links, by pyserial."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import MissingExtraError
from riot_bus_mavlink.links.stream import Stream

if TYPE_CHECKING:
    from riot_bus_mavlink.bridge.url import LinkSpec
    from riot_bus_mavlink.links.end import Host
    from riot_bus_mavlink.links.loop import Timer

__all__ = ["SerialLink"]

_RETRY_S = 1.0


class _Device:
    """pyserial sets rates; its descriptor is read and written without waiting."""

    def __init__(self, opened: Any) -> None:
        self._opened = opened
        self._number: int = opened.fileno()
        os.set_blocking(self._number, False)

    def fileno(self) -> int:
        return self._number

    def receive(self, most: int) -> bytes:
        return os.read(self._number, most)

    def send(self, data: bytes) -> int:
        return os.write(self._number, data)

    def close(self) -> None:
        self._opened.close()


class SerialLink:
    """Opens a device, and does so again when it was unplugged.

    Args:
        spec: Which.
        host: Gets what comes.

    Raises:
        MissingExtraError: pyserial is not installed.
    """

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        try:
            import serial
        except ImportError:
            raise MissingExtraError("pyserial", "mavlink") from None
        self.spec = spec
        self._serial: Any = serial
        self._host = host
        self._stream: Stream | None = None
        self._timer: Timer | None = None
        self._told = ""
        self._open()

    @property
    def where(self) -> str:
        """Return the device and its rate."""
        return self.spec.where

    @property
    def state(self) -> str:
        """Return how it is."""
        return "connecting" if self._stream is None else "connected"

    def dropped(self) -> int:
        """Return 0: nothing tells what a device has dropped."""
        return 0

    def close(self) -> None:
        """Close it."""
        if self._timer is not None:
            self._timer.cancel()
        if self._stream is not None:
            self._stream.close()

    def _open(self) -> None:
        try:
            opened = self._serial.Serial(self.spec.path, self.spec.baud, timeout=0, write_timeout=0)
            device = _Device(opened)
        except (OSError, ValueError) as error:  # pyserial's own error is an OSError
            self._again(getattr(error, "strerror", None) or str(error))
            return
        self._told = ""
        self._stream = Stream(
            self.spec, self.spec.where, transport=device, host=self._host, gone=lambda _: self._lost()
        )

    def _lost(self) -> None:
        self._stream = None
        self._again("unplugged")

    def _again(self, why: str) -> None:
        if why != self._told:
            self._told = why
            self._host.warn(self.spec, f"{why}; it is tried again")
        self._timer = self._host.loop.later(_RETRY_S, self._open)
