"""`riot agent`: runs until it is told to end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.control.signals import ended_by_signals
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config
from riot_bus_fleet.agent.service import AgentService

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.terminal import Foreground
    from riot_bus_fleet.agent.options import AgentOptions


def run_agent(options: AgentOptions, foreground: Foreground) -> None:
    """Run until SIGINT or SIGTERM, then stop the current operation.

    Raises:
        ConfigError: An option is wrong, or Zenoh refuses a configuration.
        EnvironmentFaultError: The link to the fleet failed for good.
    """
    service = AgentService(options, say=foreground.warn)
    with ended_by_signals(service.shutdown), service:
        may = " and ".join(options.allow) or "only list its logs"
        line = f"ready: agent of {options.robot}, logs in {options.folder}; may {may}"
        foreground.report("ready", {"robot": options.robot, "logs": str(options.folder)}, [line])
        _look_at_bus(options, foreground.warn)
        foreground.attend(service.stopping.wait)
    if service.failure is not None:
        raise service.failure


def _look_at_bus(options: AgentOptions, tell: Callable[[str], None]) -> None:
    """Warn if the robot's own bus does not answer; it may come up later."""
    prepare_runtime()
    try:
        release(open_session(client_config(options.endpoint, extra=options.config), purpose="bus of the robot"))
    except EnvironmentFaultError as error:
        tell(f"warning: {error.where}: {error.message}; it is tried again for each operation")
