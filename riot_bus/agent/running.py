"""`riot agent`: runs until it is told to end."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from riot_bus.agent.service import AgentService
from riot_bus.control.signals import ended_by_signals
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.agent.options import AgentOptions

__all__ = ["run_agent"]

_LOOK_S = 0.2  # so late the agent ends if the signal came just before a wait


def run_agent(
    options: AgentOptions, *, say: Callable[[str], None], tell: Callable[[str], None], as_json: bool = False
) -> None:
    """Run until SIGINT or SIGTERM, then stop the current operation.

    Args:
        options: Options of the agent.
        say: Function that prints a line of the result.
        tell: Function that prints a line for the journal.
        as_json: Whether to print the result as lines of JSON.

    Raises:
        ConfigError: An option is wrong, or Zenoh refuses a configuration.
        EnvironmentFaultError: The link to the fleet failed for good.
    """
    service = AgentService(options, say=tell)
    with ended_by_signals(service.shutdown), service:
        say(_ready(options, as_json=as_json))
        _look_at_bus(options, tell)
        while not service.stopping.wait(_LOOK_S):
            pass  # a signal just before a wait without a timeout would not end it
    if service.failure is not None:
        raise service.failure


def _ready(options: AgentOptions, *, as_json: bool) -> str:
    if as_json:
        return json.dumps({"event": "ready", "robot": options.robot, "logs": str(options.folder)}, sort_keys=True)
    may = " and ".join(options.allow) or "only list its logs"
    return f"ready: agent of {options.robot}, logs in {options.folder}; may {may}"


def _look_at_bus(options: AgentOptions, tell: Callable[[str], None]) -> None:
    """Warn if the robot's own bus does not answer; it may come up later."""
    prepare_runtime()
    try:
        release(open_session(client_config(options.endpoint, extra=options.config), purpose="bus of the robot"))
    except EnvironmentFaultError as error:
        tell(f"warning: {error.where}: {error.message}; it is tried again for each operation")
