"""Serial links, by pyserial."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import needs_extra
from riot_bus_bridges.links.stream import StreamClient

if TYPE_CHECKING:
    from riot_bus_bridges.links.link import Host
    from riot_bus_bridges.mavlink.url import LinkSpec


class _Device:
    """Device opened by pyserial, which sets the rate; its descriptor is read and written without waiting."""

    def __init__(self, opened: Any) -> None:
        self._opened = opened
        self._number: int = opened.fileno()
        os.set_blocking(self._number, False)

    def fileno(self) -> int:
        return self._number

    def recv(self, most: int) -> bytes:
        return os.read(self._number, most)

    def send(self, data: bytes) -> int:
        return os.write(self._number, data)

    def close(self) -> None:
        self._opened.close()


class SerialLink(StreamClient):
    """Opens a device, and reopens it after it was unplugged.

    Raises:
        MissingExtraError: pyserial is not installed.
    """

    lost, retry = "unplugged", 1.0

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        with needs_extra("pyserial", "mavlink"):
            import serial
        super().__init__(spec, host)
        self._serial: Any = serial
        self._try()

    def _try(self) -> None:
        try:
            device = _Device(self._serial.Serial(self.spec.path, self.spec.baud, timeout=0, write_timeout=0))
        except (OSError, ValueError) as error:  # pyserial's own error is an OSError
            self._again(getattr(error, "strerror", None) or str(error))
        else:
            self._opened(device)
