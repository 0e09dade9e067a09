"""What keys on a terminal do to a recorder."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError

if TYPE_CHECKING:
    from riot_bus.bus.capture.service import CaptureService

__all__ = ["HELP", "press"]

HELP = "space: pause, s: another file, d: write the ring, q: end"


def press(service: CaptureService, key: str) -> None:
    """Do what a key means, if anything."""
    match key:
        case " ":
            (service.resume if service.paused else service.pause)()
        case "s" | "d":
            service.cut()
        case "q":
            with suppress(ConfigError):
                service.stop()
