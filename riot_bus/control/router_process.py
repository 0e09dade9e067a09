"""`riot router`: a service that runs until it is told to stop, then says what happened."""

from __future__ import annotations

import time
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.control.heap import calm_collector, steady_heap, trim_heap
from riot_bus.control.memory import check_memory, memory_limit
from riot_bus.control.router_options import interceptors_of, intercepts, plan_of, registry_of, settings_of
from riot_bus.control.scheduling import LoadScheduling
from riot_bus.control.signals import ended_by_signals, force_end_after
from riot_bus.vocabulary.errors import DataLossError
from riot_bus.zenoh.network import Network

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from riot_bus.config.router_settings import RouterSettings
    from riot_bus.control.reach import Bypass
    from riot_bus.control.router_flags import RouterOptions
    from riot_bus.control.router_service import RouterService
    from riot_bus.control.terminal import Foreground
    from riot_bus.router.counts import Losses

_HELD_UP_S = 60.0
"""A router whose interpreter is blocked this long forwards nothing intercepted, and handles no signal: it ends."""


class Upkeep:
    """To be called often: schedules the threads of a busy process, and from time to time gives memory back.

    Until `let_run`, the process ends with a traceback of its threads if this is not called for a minute.
    """

    def __init__(self) -> None:
        self._schedule = LoadScheduling()
        self._trimmed = time.monotonic()
        self._memory = memory_limit()
        force_end_after(_HELD_UP_S)

    def __call__(self) -> None:
        """Do what is due.

        Raises:
            EnvironmentFaultError: The process uses more memory than it may.
        """
        check_memory(self._memory)
        self._schedule()
        if time.monotonic() - self._trimmed > 20.0:  # a guess: it walks all heaps of the C library
            trim_heap()
            self._trimmed = time.monotonic()
            force_end_after(_HELD_UP_S)


def run_router(options: RouterOptions, foreground: Foreground) -> None:
    """Run until SIGINT, SIGTERM or `shutdown`, then print counts.

    Raises:
        ConfigError: An option is wrong.
        EnvironmentFaultError: An endpoint is in use.
        DataLossError: It ran, but messages were lost.
    """
    with router_of(options, warn=foreground.warn) as service, ended_by_signals(service.shutdown):
        with service:
            _report_ready(service, foreground)
            service.watch()
            calm_collector()
            foreground.attend(service.stopping.wait, look=Upkeep())
        report_end(service, foreground)


@contextmanager
def router_of(
    options: RouterOptions, *, warn: Callable[[str], None], settings: RouterSettings | None = None
) -> Iterator[RouterService]:
    """Yield a router whose segments are open, but which is not open itself.

    Args:
        options: The command line of `riot router`.
        warn: Function that prints a line of diagnostics.
        settings: Settings that replace those of riot.toml and of `options`.

    Raises:
        ConfigError: An option is wrong.
        EnvironmentFaultError: An endpoint is in use.
    """
    settings = settings or settings_of(options)
    if options.carried and len(settings.segments) > 1:  # first, so that they include what else is intercepted of them
        settings = replace(settings, intercept=(*options.carried, *settings.intercept))
    with closing(Network(settings.segments)) as network:
        known = not intercepts(settings, options)  # else all that says what to intercept must be read first
        if known:
            network.begin()
        steady_heap()
        registry, interceptors, plan = registry_of(options), interceptors_of(settings, options), plan_of(options)
        if not known:
            from riot_bus.router.interception import expressions_of

            network.begin(*expressions_of(settings, interceptors=interceptors, plan=plan, registry=registry))
        from riot_bus.control.router_service import RouterService  # while Zenoh draws its routes, which takes as long

        service = RouterService(
            settings,
            interceptors=interceptors,
            plan=plan,
            registry=registry,
            seed=options.seed,
            alarm=_alarm(warn) if options.bypass_watch else None,
            network=network,
        )
        for line in service.warnings:
            warn(f"warning: {line}")
        yield service


def _report_ready(service: RouterService, foreground: Foreground) -> None:
    endpoints = service.endpoints
    where = ", ".join(f"segment {segment} {' '.join(shown)}" for segment, shown in endpoints.items())
    foreground.report(
        "ready",
        {"router": service.settings.name, "endpoints": endpoints, "intercepted": service.topics},
        [f"ready: {where}; intercepting {', '.join(service.topics) or 'nothing'}"],
    )


def report_end(service: RouterService, foreground: Foreground) -> None:
    """Report what happened to each topic.

    Raises:
        DataLossError: Messages were lost.
    """
    from riot_bus.control.status import count_rows, count_table, interceptor_rows, loss_rows
    from riot_bus.vocabulary.redaction import escape_control_chars

    counts, losses = count_rows(service.bus.counts()), service.bus.losses
    ended = {"counts": counts, "losses": loss_rows(losses), "interceptors": interceptor_rows(service.pipeline)}
    foreground.report("ended", ended, map(escape_control_chars, count_table(counts)))
    foreground.warn_of_errors(service.pipeline)
    if losses:
        raise DataLossError("; ".join(_lost(losses)), hint="see the column 'lost', by topic")


def _lost(losses: Losses) -> list[str]:
    lost = sum(losses.messages.values()) + sum(losses.recordings.values())
    reasons = ", ".join(f"{reason}: {number}" for reason, number in losses.reasons.items())
    why = f" ({reasons})" if reasons else ""
    return [*([f"{lost} messages were lost{why}"] if lost else []), *map(str, losses.links)]


def _alarm(warn: Callable[[str], None]) -> Callable[[list[Bypass]], None]:
    def alarm(bypasses: list[Bypass]) -> None:
        from riot_bus.control.status import bypass_rows
        from riot_bus.control.status_text import bypass_lines

        for line in bypass_lines(bypass_rows(bypasses)) or ["bypass: the ways around the router are closed"]:
            warn(line)

    return alarm
