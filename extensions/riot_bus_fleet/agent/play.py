"""An agent's player: that of `riot play`, controlled remotely."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.play.service import PlayService
from riot_bus_fleet.agent.operation import Operation
from riot_bus_fleet.agent.request import check_key

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import ExitStack

    from riot_bus_fleet.agent.options import AgentOptions
    from riot_bus_fleet.agent.request import PlayRequest

_MOST_ROWS = 20  # with `_LONGEST`: a result's texts take at most 12,000 characters of the status
_LONGEST = 300  # a guess: texts of problems may quote payloads of any length


class Play(Operation[PlayService]):
    """Plays logs into the robot's own bus.

    Args:
        agent: Options of the robot's agent, which name the bus.
    """

    kind = "play"

    def __init__(
        self,
        request: PlayRequest,
        names: Sequence[str],
        files: Sequence[Path],
        agent: AgentOptions,
        changed: Callable[[], None],
    ) -> None:
        super().__init__(request, changed)
        self._request, self._names, self._files, self._agent = request, list(names), files, agent
        self._last = {"logs": self._names}

    def seek(self, seconds: float) -> None:
        """Continue at a time in seconds from the logs' beginning."""
        self._running().seek(seconds)
        self.changed()

    def set_rate(self, rate: float) -> None:
        """Continue at another speed; raises ConfigError if it is invalid."""
        self._running().set_rate(rate)
        self.changed()

    def _open(self, stack: ExitStack) -> PlayService:
        service = PlayService(self._request.options(self._agent, self._files, self._plan(stack)), warn=self.warn)
        stack.callback(service.close)  # also if a key is refused
        for key in service.programme.cast.offers:
            check_key(key, where="logs")
        return service

    def _row(self, service: PlayService) -> dict[str, Any]:
        status = service.status()
        return {**{name: value for name, value in status.items() if name not in ("name", "pid")}, "logs": self._names}

    def _result(self, service: PlayService) -> dict[str, Any]:
        result = service.result()
        return {
            "published": result.published,
            "seconds": result.seconds,
            "passes": result.passes,
            "lost": dict(result.lost.most_common(_MOST_ROWS)),
            "problems": {name: text[:_LONGEST] for name, text in list(result.problems.items())[:_MOST_ROWS]},
            "unread": {Path(name).name: text[:_LONGEST] for name, text in list(result.unread.items())[:_MOST_ROWS]},
        }

    def _plan(self, stack: ExitStack) -> Path | None:
        """Write the injection plan where the player can read it."""
        if self._request.inject is None:
            return None
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="riot-agent-"))) / "inject.toml"
        path.write_text(self._request.inject, encoding="utf-8")
        return path
