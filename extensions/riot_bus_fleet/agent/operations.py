"""An agent's player and recorder: those of `riot play` and `riot record`, controlled remotely."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.play.service import PlayService
from riot_bus.record.service import CaptureService
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_fleet.agent.operation import Operation
from riot_bus_fleet.agent.request import check_key

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import ExitStack

    from riot_bus.record.options import CaptureOptions
    from riot_bus_fleet.agent.options import AgentOptions
    from riot_bus_fleet.agent.request import PlayRequest, RecordRequest

_MOST_ROWS = 20  # with `_LONGEST`: a result's texts take at most 12,000 characters of the status
_LONGEST = 300  # a guess: texts of problems may quote payloads of any length


class Play(Operation[PlayService]):
    """Plays logs into the robot's own bus."""

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


class RecordOperation(Operation[CaptureService]):
    """Records the robot's own bus into its folder of logs."""

    kind = "record"

    def __init__(
        self, request: RecordRequest, options: CaptureOptions, agent: AgentOptions, changed: Callable[[], None]
    ) -> None:
        super().__init__(request, changed)
        self._options, self._agent = options, agent

    def _open(self, stack: ExitStack) -> CaptureService:
        check_room(self._agent)
        return CaptureService(self._options, warn=self.warn)

    def _look(self) -> None:
        try:
            check_room(self._agent)
        except EnvironmentFaultError as error:
            self.stop(error.message)

    def _row(self, service: CaptureService) -> dict[str, Any]:
        status = service.status()
        names = ("bytes", "connected", "state", "seconds", "lost", "reasons", "left_out", "files")
        file = str(status["file"])
        return {
            **{name: status[name] for name in names},
            "recorded": status["messages"],
            "logs": [file.removeprefix(f"{self._agent.folder.resolve()}/")] if file else [],
        }

    def _result(self, service: CaptureService) -> dict[str, Any]:
        result = service.result()
        account = result.account
        return {
            "recorded": sum(account.recorded.values()),
            "seconds": round(result.seconds, 3),
            "lost": {name: sum(topics.values()) for name, topics in account.lost.items() if any(topics.values())},
            "problems": {str(number): text[:_LONGEST] for number, text in enumerate(result.problems[:_MOST_ROWS], 1)},
            "files": [Path(each.path).name for each in result.files[:_MOST_ROWS]],
        }


def check_room(agent: AgentOptions) -> None:
    """Raise EnvironmentFaultError if the disk is too full to record."""
    free = shutil.disk_usage(agent.folder).free
    if free < agent.keep_free:
        text = f"the disk has {free >> 20} MiB left, and {agent.keep_free >> 20} MiB are to be kept free"
        raise EnvironmentFaultError(text, where=agent.robot, hint="delete logs there, or see riot agent --keep-free")
