"""`riot bridge ...`: bridge until told to end, then summarise what crossed."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from riot_bus.control.exposure import bridge_warnings
from riot_bus.control.signals import ended_by_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.terminal import Foreground
    from riot_bus_bridges.bridging import Bridge
    from riot_bus_bridges.host.program import Program


def run_bridge(
    bridge: Bridge,
    foreground: Foreground,
    *,
    program: Callable[[], Program] | None = None,
    look: Callable[[], None] = lambda: None,
) -> int:
    """Bridge until SIGINT, SIGTERM, a failure, or the end of the program behind it.

    Args:
        look: Function called a few times per second.

    Returns:
        The program's exit status, negative for a signal; 0 if it was still running, or there is none.

    Raises:
        RiotError: The bridge does not start, or has failed.
    """
    for line in bridge_warnings(bridge.listens):
        foreground.warn(f"warning: {line}")
    status: int | None = None
    with ended_by_signals(bridge.stop):
        with bridge, ExitStack() as stack:
            foreground.report("ready", bridge.status(), [bridge.ready()])
            behind = stack.enter_context(program()) if program is not None else None
            foreground.attend(bridge.wait, look=look)
            status = behind.status if behind is not None else None
        foreground.report("ended", bridge.status(), bridge.summary())
    if bridge.failure is not None:
        raise bridge.failure
    return status or 0
