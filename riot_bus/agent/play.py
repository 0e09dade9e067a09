"""An agent's player: that of `riot play`, controlled remotely."""

from __future__ import annotations

import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.agent.operation import Operation
from riot_bus.agent.request import check_key
from riot_bus.play.service import PlayService

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.agent.options import AgentOptions
    from riot_bus.agent.request import PlayRequest
    from riot_bus.play.service import PlayResult

__all__ = ["Play"]

_LOOK_S = 0.1  # so late a player that hangs is given up; other ends wake it
_MOST_ROWS = 20  # with `_LONGEST`: a result's texts take at most 12,000 characters of the status
_LONGEST = 300  # a guess: texts of problems may quote payloads of any length


class Play(Operation):
    """Plays logs into the robot's own bus.

    Args:
        request: The controller's request.
        names: The logs, as the controller calls them.
        files: Paths of the logs' files.
        agent: Options of the robot's agent, which name the bus.
        changed: Called whenever the status changes.
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
        self._lock = threading.Lock()
        self._service: PlayService | None = None
        self._last = {"logs": self._names}

    def pause(self) -> None:
        """Pause."""
        self._playing().pause()
        self.changed()

    def resume(self) -> None:
        """Resume."""
        self._playing().resume()
        self.changed()

    def seek(self, seconds: float) -> None:
        """Continue at a time in seconds from the logs' beginning."""
        self._playing().seek(seconds)
        self.changed()

    def set_rate(self, rate: float) -> None:
        """Continue at another speed; raises ConfigError if it is invalid."""
        self._playing().set_rate(rate)
        self.changed()

    def _work(self) -> dict[str, Any]:
        with ExitStack() as stack:
            service = PlayService(self._request.options(self._agent, self._files, self._plan(stack)), warn=self.warn)
            stack.callback(service.close)
            for key in service.programme.cast.offers:
                check_key(key, where="logs")
            if self._stopping.is_set():
                return {"logs": self._names}
            service.start()
            with self._lock:
                self._service = service
            if self._stopping.is_set():
                service.stop()
            self.changed()
            while not service.wait(_LOOK_S):
                pass
            with self._lock:
                self._last, self._service = self._row(service), None
            return {**self._last, "result": _result(service.result())}

    def _stop(self) -> None:
        with self._lock:
            if self._service is not None:
                self._service.stop()

    def _details(self) -> dict[str, Any] | None:
        with self._lock:
            return None if self._service is None else self._row(self._service)

    def _row(self, service: PlayService) -> dict[str, Any]:
        status = service.status()
        return {**{name: value for name, value in status.items() if name not in ("name", "pid")}, "logs": self._names}

    def _playing(self) -> PlayService:
        with self._lock:
            if self._service is None or self._stopping.is_set():
                raise self._not_begun()
            return self._service

    def _plan(self, stack: ExitStack) -> Path | None:
        """Write the injection plan where the player can read it."""
        if self._request.inject is None:
            return None
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="riot-agent-"))) / "inject.toml"
        path.write_text(self._request.inject, encoding="utf-8")
        return path


def _result(result: PlayResult) -> dict[str, Any]:
    """Return the result as JSON values of limited length."""
    return {
        "published": result.published,
        "seconds": result.seconds,
        "passes": result.passes,
        "lost": dict(result.lost.most_common(_MOST_ROWS)),
        "problems": {name: text[:_LONGEST] for name, text in list(result.problems.items())[:_MOST_ROWS]},
        "unread": {Path(name).name: text[:_LONGEST] for name, text in list(result.unread.items())[:_MOST_ROWS]},
    }
