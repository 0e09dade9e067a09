"""`riot bridge ...`: bridge until told to end, then summarise what crossed."""

from __future__ import annotations

import json
from contextlib import ExitStack
from typing import TYPE_CHECKING

from riot_bus.control.signals import ended_by_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.bridge.program import Program
    from riot_bus.types.bridging import Bridge

__all__ = ["run_bridge"]

_LOOK_S = 0.2  # so late the bridge ends if the signal came just before a wait


def _nothing() -> None:
    """Do nothing."""


def run_bridge(
    bridge: Bridge,
    *,
    say: Callable[[str], None],
    as_json: bool = False,
    program: Callable[[], Program] | None = None,
    look: Callable[[], None] = _nothing,
) -> int:
    """Bridge until SIGINT, SIGTERM, a failure, or the end of the program behind it.

    Args:
        bridge: The bridge; it is started and ended here.
        say: Function that prints a line of the result.
        as_json: Whether to print the result as lines of JSON.
        program: Function that starts the program behind the bridge, once that is ready.
        look: Called a few times per second.

    Returns:
        The program's exit status, negative for a signal; 0 if it was still running, or there is none.

    Raises:
        RiotError: The bridge does not start, or has failed.
    """
    status: int | None = None
    with ended_by_signals(bridge.stop):
        with bridge, ExitStack() as stack:
            say(json.dumps({"event": "ready", **bridge.status()}, sort_keys=True) if as_json else bridge.ready())
            behind = stack.enter_context(program()) if program is not None else None
            while not bridge.wait(_LOOK_S):  # a signal just before a wait without a timeout would not end it
                look()
            status = behind.status if behind is not None else None
        if as_json:
            say(json.dumps({"event": "ended", **bridge.status()}, sort_keys=True))
        else:
            for line in bridge.summary():
                say(line)
    if bridge.failure is not None:
        raise bridge.failure
    return status or 0
