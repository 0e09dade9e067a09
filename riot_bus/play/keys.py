"""Control of a player by keys on a terminal."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.play.service import PlayService

HELP = "space: pause, s or →: step, ↑ ↓: faster, slower, [ ]: 10 s back, on, 0: from the beginning, q: end"

_LOWEST, _HIGHEST = 0.01, 1000.0  # keys go no further; beyond, `-r` or rate 0 will do


def key_actions(service: PlayService) -> dict[str, Callable[[], None]]:
    """Return the action of each key: a letter, or `up`, `down` and `right`."""

    def toggle() -> None:
        (service.resume if service.status()["state"] == "paused" else service.pause)()

    def seek(seconds: float) -> None:
        service.seek(service.status()["position"] + seconds)

    def accelerate(factor: float) -> None:
        rate = service.status()["rate"]
        if rate:  # 0, as fast as possible, stays 0
            service.set_rate(float(f"{min(max(_HIGHEST, rate), max(min(_LOWEST, rate), rate * factor)):.3g}"))

    faster, slower = partial(accelerate, 1.1), partial(accelerate, 1 / 1.1)  # as in `ros2 bag play`
    return {
        " ": toggle,
        "s": service.step,
        "right": service.step,
        "up": faster,
        "+": faster,
        "down": slower,
        "-": slower,
        "]": partial(seek, 10.0),
        "[": partial(seek, -10.0),
        "0": lambda: service.seek(service.status()["start"]),
        "q": service.stop,
    }
