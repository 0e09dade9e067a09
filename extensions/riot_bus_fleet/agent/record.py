"""An agent's recorder: that of `riot record`, controlled remotely."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.record.service import CaptureService
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_fleet.agent.operation import Operation

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import ExitStack

    from riot_bus.record.options import CaptureOptions
    from riot_bus_fleet.agent.options import AgentOptions
    from riot_bus_fleet.agent.request import RecordRequest

_MOST_ROWS = 20  # with `_LONGEST`: a result's problems take at most 6,000 characters of the status
_LONGEST = 300  # as in play.py: problems may quote payloads of any length
_MIB = 1 << 20  # bytes: the unit in which people are told what is free


class RecordOperation(Operation[CaptureService]):
    """Records the robot's own bus into its folder of logs.

    It ends by itself when the disk becomes too full.
    """

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
        text = f"the disk has {free // _MIB} MiB left, and {agent.keep_free // _MIB} MiB are to be kept free"
        raise EnvironmentFaultError(text, where=agent.robot, hint="delete logs there, or see riot agent --keep-free")
