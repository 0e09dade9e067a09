"""`riot bridge ...`: bridges until it is told to end, then says what crossed."""

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

_LOOK_S = 0.2


def _nothing() -> None:
    """Have nothing to look at."""


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
        say: Prints a line of the result.
        as_json: Say it as lines of JSON.
        program: Starts the program behind it, once it is ready.
        look: Called a few times in a second.

    Returns:
        The program's exit status, negative for a signal; 0 if it was still running, or there is none.

    Raises:
        RiotError: It does not start, or has failed.
    """
    status: int | None = None
    with ended_by_signals(bridge.stop):
        with bridge, ExitStack() as stack:
            say(json.dumps({"event": "ready", **bridge.status()}, sort_keys=True) if as_json else bridge.ready())
            behind = stack.enter_context(program()) if program is not None else None
            while not bridge.wait(_LOOK_S):  # a signal that comes just before an endless wait does not end that
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
