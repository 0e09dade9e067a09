"""Logs of ground stations (`.tlog`) as links: read in their own time, or written."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.errors import EnvironmentFaultError
from riot_bus_mavlink.links.udp import reason

if TYPE_CHECKING:
    from typing import BinaryIO

    from riot_bus_mavlink.bridge.url import LinkSpec
    from riot_bus_mavlink.links.end import End, Host

__all__ = ["LogWriter"]


class LogWriter:
    """Appends all that is sent to it, each frame after its time: microseconds since the Unix epoch, 8 bytes big-endian.

    Args:
        spec: Which file; it gets everything, whoever it is for.
        host: Sends.

    Raises:
        EnvironmentFaultError: The file cannot be written.
    """

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        self.spec = spec
        self._host = host
        self._lock = threading.Lock()
        try:
            self._file: BinaryIO | None = Path(spec.path).open("ab")  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise EnvironmentFaultError(f"cannot be written: {reason(error)}", where=spec.path) from error
        self._end: End = host.join(spec, spec.path, self._write)
        self._timer = host.loop.later(1.0, self._flush)

    @property
    def where(self) -> str:
        """Return the file."""
        return self.spec.path

    @property
    def state(self) -> str:
        """Return how it is."""
        return "ended" if self._file is None else "writing"

    def dropped(self) -> int:
        """Return 0."""
        return 0

    def close(self) -> None:
        """Close it."""
        self._timer.cancel()
        with self._lock:
            if self._file is not None:
                self._file.close()
                self._file = None
        self._host.leave(self._end)

    def _write(self, data: bytes) -> bool:
        with self._lock:
            if self._file is None:
                return False
            try:
                self._file.write((time.time_ns() // 1000).to_bytes(8, "big") + data)
            except OSError as error:
                self._host.warn(self.spec, reason(error))
                return False
            return True

    def _flush(self) -> None:
        with self._lock:
            if self._file is not None:
                try:
                    self._file.flush()
                except OSError as error:
                    self._host.warn(self.spec, reason(error))
        self._timer = self._host.loop.later(1.0, self._flush)
