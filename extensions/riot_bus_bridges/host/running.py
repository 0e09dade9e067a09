"""`riot bridge ...`: bridge until told to end, then summarise what crossed."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Self

from riot_bus.control.exposure import bridge_warnings
from riot_bus.control.signals import END_S, ended_by_signals, force_end_after, let_run
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from riot_bus.control.router_flags import RouterOptions
    from riot_bus.control.router_service import RouterService
    from riot_bus.control.terminal import Foreground
    from riot_bus_bridges.bridging import Bridge, LinkedBridge
    from riot_bus_bridges.host.inner import InnerPort


class Program:
    """A program behind a bridge, with the streams of this process; a context manager that ends it.

    Attributes:
        status: Exit status, negative for a signal, None while it runs.

    Raises:
        EnvironmentFaultError: It cannot be started.
    """

    def __init__(self, command: Sequence[str], bridge: Bridge) -> None:
        self.status: int | None = None
        words = bridge.words()
        try:
            self._process = subprocess.Popen([_filled(part, words) for part in command])
        except OSError as error:
            raise EnvironmentFaultError(
                f"{command[0]!r} cannot be started: {error.strerror or error}", where="bridge"
            ) from error
        self._ended = bridge.stop
        self._thread = threading.Thread(target=self._wait, name="bridge-program", daemon=True)
        self._thread.start()

    def _wait(self) -> None:
        self.status = self._process.wait()
        self._ended()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.terminate()
        self._thread.join(3.0)
        self._process.kill()
        self._thread.join()


def end_as(status: int) -> int:
    """End this process by the signal that ended a program; return the status if it ended otherwise."""
    if status < 0:
        signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    return status


def _filled(text: str, words: Mapping[str, str]) -> str:
    for word, value in words.items():
        text = text.replace(f"{{{word}}}", value)
    return text


def run_bridge(
    bridge: Bridge,
    foreground: Foreground,
    program: Sequence[str] = (),
    *,
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
            behind = stack.enter_context(Program(program, bridge)) if program else None
            foreground.attend(bridge.wait, look=look)
            status = behind.status if behind is not None else None
        foreground.report("ended", bridge.status(), bridge.summary())
    if bridge.failure is not None:
        raise bridge.failure
    return status or 0


def run_own_router(
    options: RouterOptions,
    bridge_of: Callable[[Mapping[str, InnerPort]], LinkedBridge],
    foreground: Foreground,
    program: Sequence[str] = (),
) -> int:
    """Route and bridge until told to end, or the program behind the bridge ends; raises RiotError if that fails."""
    from riot_bus.control.router_process import report_end, router_of
    from riot_bus_bridges.host.inner import InnerPort
    from riot_bus_bridges.host.local_ingress import InnerNetwork

    with router_of(options, warn=foreground.warn) as service:
        with ExitStack() as closing, service:
            network = InnerNetwork(service.bus)
            bridge = bridge_of({name: InnerPort(network, name) for name in service.settings.segments})
            service.bus.show(bridge.links)
            looks = _looks(service, bridge)
            status = run_bridge(bridge, foreground, program, look=partial(next, looks))
            closing.callback(let_run)
            force_end_after(END_S)
        report_end(service, foreground)
    return status


def _looks(service: RouterService, bridge: Bridge) -> Iterator[None]:
    from riot_bus.control.router_process import Upkeep

    service.watch()  # it takes longer than all the rest
    upkeep = Upkeep()
    while True:
        upkeep()
        if service.stopping.is_set():
            bridge.stop()
        yield
