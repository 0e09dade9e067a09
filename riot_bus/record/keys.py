"""Control of a recorder by keys on a terminal."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from riot_bus.record.service import CaptureService

__all__ = ["keys_help", "press"]

_HELP = "space: pause, {cut}, q: end"


def keys_help(*, ring: bool) -> str:
    """Return what the keys do, in a line."""
    return _HELP.format(cut="d: write the ring" if ring else "s: another file")


def press(service: CaptureService, key: str) -> None:
    """Perform the action of a key, if it has one."""
    match key:
        case " ":
            (service.resume if service.paused else service.pause)()
        case "s" | "d":
            service.cut()
        case "q":
            with suppress(ConfigError):
                service.stop()
