"""A bridge that is its own router: frames go from link to link, through interceptors, in one process."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from riot_bus.control.router_process import Upkeep, report_end, router_of
from riot_bus.control.signals import END_S, force_end_after, let_run
from riot_bus_bridges.bridging import LinkedBridge
from riot_bus_bridges.host.inner import InnerPort
from riot_bus_bridges.host.local_ingress import InnerNetwork
from riot_bus_bridges.host.running import run_bridge

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from riot_bus.control.router_flags import RouterOptions
    from riot_bus.control.router_service import RouterService
    from riot_bus.control.terminal import Foreground
    from riot_bus_bridges.bridging import Bridge
    from riot_bus_bridges.host.program import Program

BridgeT = TypeVar("BridgeT", bound=LinkedBridge)


def run_own_router(
    options: RouterOptions,
    bridge_of: Callable[[Mapping[str, InnerPort]], BridgeT],
    foreground: Foreground,
    *,
    program: Callable[[BridgeT], Program] | None = None,
) -> int:
    """Route and bridge until SIGINT, SIGTERM, or the end of the program behind the bridge.

    Returns:
        Exit status, as that of `run_bridge`.

    Raises:
        RiotError: The router or bridge does not start, has failed, or messages were lost.
    """
    with router_of(options, warn=foreground.warn) as service:
        with ExitStack() as closing, service:
            network = InnerNetwork(service.bus)
            bridge = bridge_of({name: InnerPort(network, name) for name in service.settings.segments})
            service.bus.show(bridge.links)
            looks = _looks(service, bridge)
            start = None if program is None else partial(program, bridge)
            status = run_bridge(bridge, foreground, program=start, look=partial(next, looks))
            closing.callback(let_run)
            force_end_after(END_S)
        report_end(service, foreground)
    return status


def _looks(service: RouterService, bridge: Bridge) -> Iterator[None]:
    service.watch()  # it takes longer than all the rest
    upkeep = Upkeep()
    while True:
        upkeep()
        if service.stopping.is_set():
            bridge.stop()
        yield
