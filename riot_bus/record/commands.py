"""The commands that a recorder takes while it runs, under `@riot/<name>/record/...`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.control.commands import Command
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.commands import CommandRequest
    from riot_bus.record.service import CaptureService

__all__ = ["CAPTURE_COMMANDS", "UNDER"]

UNDER = "record/**"
"""The keys of these commands, below the recorder's own."""


def _told(do: Callable[[CaptureService], object]) -> Command:
    def run(service: CaptureService, request: CommandRequest) -> dict[str, Any]:
        do(service)
        return service.status()

    return Command(run)


def _start(service: CaptureService) -> None:
    if not service.paused:
        hint = "split it (riot ctl record split), or stop it (riot ctl record stop)"
        raise ConfigError("this recorder records already", where="record/start", hint=hint)
    service.resume()


def _split(service: CaptureService, request: CommandRequest) -> dict[str, Any]:
    former, present = service.split(request.path())
    return {"former": str(former), "file": str(present)}


CAPTURE_COMMANDS: dict[str, Command] = {
    "record/status": Command(lambda service, _: service.status(), reads=True),
    "record/start": _told(_start),
    "record/pause": _told(lambda service: service.pause()),
    "record/resume": _told(lambda service: service.resume()),
    "record/split": Command(_split),
    "record/dump": Command(lambda service, request: {"dumped": str(service.dump(request.path()))}),
    "record/stop": _told(lambda service: service.stop()),
}
"""All commands by name."""
