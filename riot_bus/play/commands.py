"""What a player can be told from elsewhere, under `@riot/<name>/play/`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.control.commands import Command
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.commands import CommandRequest
    from riot_bus.play.service import PlayService

__all__ = ["PLAY_COMMANDS", "UNDER"]

UNDER = "play/**"
"""The keys of these commands, below the player's own."""

_MOST_STEPS = 1_000_000
_LARGEST = 1e12


def _number(request: CommandRequest, name: str, default: float | None = None) -> float:
    found = request.argument(name)
    if found is None and default is not None:
        return default
    if isinstance(found, bool) or not isinstance(found, int | float) or not abs(found) <= _LARGEST:
        raise ConfigError(f"the argument {name!r} is no number", hint=f'such as {{"{name}": 2.5}}')
    return float(found)


def _told(do: Callable[[PlayService, CommandRequest], object]) -> Command:
    def run(service: PlayService, request: CommandRequest) -> dict[str, Any]:
        do(service, request)
        return service.status()

    return Command(run)


def _step(service: PlayService, request: CommandRequest) -> None:
    count = _number(request, "count", 1.0)
    if not 1 <= count <= _MOST_STEPS or count != int(count):
        raise ConfigError(f"{count:g} is no number of steps", hint=f"1 to {_MOST_STEPS}")
    service.step(int(count))


PLAY_COMMANDS: dict[str, Command] = {
    "play/status": Command(lambda service, _: service.status(), reads=True),
    "play/pause": _told(lambda service, _: service.pause()),
    "play/resume": _told(lambda service, _: service.resume()),
    "play/step": _told(_step),
    "play/seek": _told(lambda service, request: service.seek(_number(request, "time"))),
    "play/rate": _told(lambda service, request: service.set_rate(_number(request, "rate"))),
    "play/stop": _told(lambda service, _: service.stop()),
}
"""All commands by name; each answers with the status."""
