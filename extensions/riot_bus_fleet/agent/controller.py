"""`riot fleet play` and `record`: start an operation on a robot, show its progress, and report its result."""

from __future__ import annotations

import json
import threading
from typing import TYPE_CHECKING, Any

from riot_bus.control.remote import error_from
from riot_bus.control.signals import ended_by_signals
from riot_bus.vocabulary.errors import DataLossError, EnvironmentFaultError
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus_fleet.agent.operation import FINAL
from riot_bus_fleet.agent.remote_operation import RemoteOperation
from riot_bus_fleet.agent.text import operation_line, silence_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus_fleet.agent.options import ControllerOptions

_LOSSES = ("lost", "problems", "unread")


def drive(
    robot: str,
    kind: str,
    arguments: Mapping[str, Any],
    options: ControllerOptions,
    *,
    say: Callable[[str], None],
    show: Callable[[str], None],
    as_json: bool = False,
) -> bool:
    """Run an operation on a robot and follow it to its end.

    Raises:
        RiotError: The operation was refused, failed, was stopped by another user, or the robot was silent too long.
        DataLossError: The operation ended, but messages were lost.
    """
    interrupted = threading.Event()

    def told(status: dict[str, Any] | None, silent: float) -> None:
        show(operation_line(status) if status is not None else silence_line(silent))

    remote = RemoteOperation(options.endpoint, robot, config=options.config)
    with ended_by_signals(interrupted.set), remote as operation:
        operation.begin(kind, arguments, watched=not options.detach)
        until = _begun if options.detach else lambda _: False
        status = operation.follow(told, give_up=options.give_up, until=until, interrupted=interrupted.is_set)
    show("")
    say(json.dumps(status, sort_keys=True) if as_json else operation_line(status))
    _judge(robot, status, interrupted=interrupted.is_set())
    return not interrupted.is_set()


def _begun(status: Mapping[str, Any]) -> bool:
    return status["state"] not in ("starting", "stopping")


def _judge(robot: str, status: Mapping[str, Any], *, interrupted: bool) -> None:
    """Raise the error that an operation's status reports, if any."""
    problem, result = status.get("problem"), status.get("result")
    if isinstance(problem, dict):
        raise error_from(problem)
    if status["state"] == "stopped" and not interrupted:
        raise EnvironmentFaultError(escape_control_chars(f"ended before its end: {status.get('reason')}"), where=robot)
    if status["state"] in FINAL and isinstance(result, dict):
        tables = [table for part in _LOSSES if isinstance(table := result.get(part), dict)]
        lost = [f"{name}: {what}" for table in tables for name, what in table.items()]
        if lost:
            raise DataLossError(escape_control_chars("; ".join(lost[:5])), where=robot)
