"""Control of a player by keys on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.play.service import PlayService

__all__ = ["HELP", "press"]

HELP = "space: pause, s or →: step, ↑ ↓: faster, slower, [ ]: 10 s back, on, 0: from the beginning, q: end"

_FASTER = 1.1  # a tenth, as in `ros2 bag play`; 24 presses change the rate tenfold
_SEEK_S = 10.0  # `HELP` says so; usual in players of videos
_LOWEST, _HIGHEST = 0.01, 1000.0  # keys go no further; beyond, `-r` or rate 0 will do


def press(service: PlayService, key: str) -> None:
    """Perform the action of a key, if it has one.

    Args:
        service: The playback that is controlled.
        key: A letter, or `up`, `down` and `right`.
    """
    match key:
        case " ":
            (service.resume if service.status()["state"] == "paused" else service.pause)()
        case "s" | "right":
            service.step()
        case "up" | "+":
            _accelerate(service, _FASTER)
        case "down" | "-":
            _accelerate(service, 1 / _FASTER)
        case "]":
            service.seek(service.status()["position"] + _SEEK_S)
        case "[":
            service.seek(service.status()["position"] - _SEEK_S)
        case "0":
            service.seek(service.status()["start"])
        case "q":
            service.stop()


def _accelerate(service: PlayService, factor: float) -> None:
    rate = service.status()["rate"]
    if rate:  # 0, as fast as possible, stays 0
        service.set_rate(float(f"{min(max(_HIGHEST, rate), max(min(_LOWEST, rate), rate * factor)):.3g}"))
