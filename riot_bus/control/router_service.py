"""All that one `riot router` is: a bus, its interceptors and plan, its recording, its watches, and its control."""

from __future__ import annotations

import logging
import os
import threading
import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus import __version__
from riot_bus.control import status
from riot_bus.control.commands import Command
from riot_bus.control.exposure import exposure_warnings
from riot_bus.control.recordings import Recordings
from riot_bus.control.watches import Watches
from riot_bus.router.bus import Bus
from riot_bus.router.interception import Interception, wanted_keys
from riot_bus.router.pipeline_executor import end_interceptors
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import EnvironmentFaultError, RiotError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.scouting import THIS_HOST

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.config.router_settings import RouterSettings
    from riot_bus.control.commands import CommandRequest
    from riot_bus.control.reach import Bypass
    from riot_bus.graph.model import Graph
    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.pipeline.runner import Pipeline
    from riot_bus.zenoh.network import Network
    from riot_bus.zenoh.scouting import Scouting

_LOG = logging.getLogger(__name__)


class RouterService:
    """A running router; a context manager. Its operations may be called by several threads.

    Args:
        settings: Settings as `router_options.merged` returns them, with at least one segment.
        interceptors: Interceptors, carried out in this order.
        plan: Injections, carried out last.
        seed: Seed of plans that are loaded; it is also written into recordings.
        folder: Folder for recordings requested over the network; by default that of `settings.record`, else the working
            folder.
        alarm: Called with all ways around the router whenever they have changed; None not to look for them.
        scouting: Settings for asking who answers multicast scouting; None not to ask.
        network: The segments, if they are open already; it is closed with the router.
    """

    def __init__(
        self,
        settings: RouterSettings,
        *,
        interceptors: Sequence[object] = (),
        plan: InjectionPlan | None = None,
        registry: TypeRegistry | None = None,
        seed: int = 0,
        folder: Path | None = None,
        alarm: Callable[[list[Bypass]], None] | None = lambda bypasses: None,
        scouting: Scouting | None = THIS_HOST,
        network: Network | None = None,
    ) -> None:
        from riot_bus.pipeline.runner import Pipeline

        self.settings = settings
        self.stopping = threading.Event()  # set by `shutdown`
        self.warnings = exposure_warnings(settings)  # one line for each listener that is open to the network
        self._registry = registry or TypeRegistry()
        self._alarm, self._scouting = alarm, scouting
        self._bus: Bus | None = None
        self._network = network
        self._began = time.monotonic()
        self._watches: Watches | None = None
        self._stack = ExitStack()
        keys = wanted_keys(settings, self._registry)
        interception = Interception(
            lambda: self.bus, keys=keys, interceptors=interceptors, plan=plan, registry=self._registry
        )
        record = None if settings.record is None else Path(settings.record)
        recordings = Recordings(
            lambda: self.bus,
            registry=self._registry,
            folder=folder or (record.parent if record is not None else Path.cwd()),
            name=settings.name,
            metadata=self._metadata,
            profile="ros2" if any(topic.startswith("/") for topic in interception.topics) else None,
        )
        self._interception, self._recordings, self._seed = interception, recordings, seed
        self._changing = threading.RLock()
        self._closed = False
        self._clearing = threading.Lock()
        self._cleared = threading.Event()  # set by the next `plan_clear`, which ends all plans loaded until then
        if plan is not None:
            plan.injector.ended = self._cleared.is_set
        self.pipeline: Pipeline = Pipeline(
            interception.interceptors(plan), registry=self._registry, provenance=record is not None
        )

    def __enter__(self) -> Self:
        """Open segments, recording and control; `watch` opens the rest.

        Raises:
            ConfigError: Zenoh refuses a configuration, or the recording cannot be written.
            EnvironmentFaultError: An endpoint is in use.
        """
        from riot_bus.control.server import Control

        with ExitStack() as stack:
            stack.callback(end_interceptors, self.pipeline)
            self.pipeline.start()
            path = self.settings.record
            recorder = self._recordings.begin(Path(path)) if path is not None else None
            stack.callback(self._recordings.close)
            self._bus = Bus(
                self._network or self.settings.segments,
                intercept=self._interception.expressions,
                services=self._interception.services,
                pipeline=self.pipeline,
                registry=self._registry,
                recorder=recorder,
                record=["**"] if recorder is not None else (),
                budget_s=self.settings.budget,
            )
            stack.enter_context(self._bus)
            sessions = {name: self._bus.sessions[name] for name in self.settings.controlled_from}
            stack.enter_context(Control(self, self.settings.name, sessions, commands=ROUTER_COMMANDS))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        ended = self._changing.acquire(timeout=10.0)  # a change in progress: as long as a bus may take to open
        self._closed = True
        if ended:
            self._changing.release()
        self._stack.close()

    def watch(self) -> None:
        """Start to watch the graph and ways around the router; separate from opening, since it takes longer."""
        watches = Watches(
            self.bus,
            registry=self._registry,
            changed=self._recordings.graph_notes.update,
            alarm=self._alarm,
            scouting=self._scouting,
        )
        self._stack.enter_context(watches)
        self._watches = watches
        self._recordings.watch()

    # -- changes, one at a time ---------------------------------------------------------------------------------------

    def intercept_add(self, keys: Sequence[str]) -> list[str]:
        """Intercept more keys; ROS names such as `/odom` will do.

        Natively routed messages are interrupted for about 100 ms; no intercepted ones are lost.

        Returns:
            The key expressions that are intercepted now.

        Raises:
            ConfigError: One of them is not usable; then nothing has changed.
        """
        with self._changing:
            return self._interception.add(keys)

    def intercept_remove(self, keys: Sequence[str]) -> list[str]:
        """Intercept fewer keys, as `intercept_add`; raises ConfigError if one is not intercepted or a plan needs it."""
        with self._changing:
            return self._interception.remove(keys)

    def plan_load(self, text: str, name: str) -> dict[str, Any]:
        """Carry out an injection plan from now on instead of the present one, and intercept its topics.

        Raises:
            ConfigError: It is not a plan; then nothing has changed.
            EnvironmentFaultError: `plan_clear` was called meanwhile.
        """
        from riot_bus.inject.injection_plan import InjectionPlan  # loads pydantic

        cleared = self._cleared
        plan = InjectionPlan.parse(text, name, seed=self._seed)
        plan.injector.ended = cleared.is_set
        with self._changing:
            if not cleared.is_set():
                self._interception.set_plan(plan)
            if cleared.is_set():
                self._forget_cleared()
                raise EnvironmentFaultError(f"plan/clear came before {name} was loaded", hint="load it again")
            return {"intercepted": self._interception.intercepted, "plan": status.plan_row(plan)}

    def plan_clear(self) -> dict[str, Any]:
        """Stop carrying out plans, those included that are being loaded; this never waits for another change.

        What was intercepted for the plan alone is so no longer once no other change is in progress.
        """
        former = self._interception.plan
        with self._clearing:
            cleared, self._cleared = self._cleared, threading.Event()
            cleared.set()
        self.bus.forget()
        if former is not None:
            # Usually it takes 0.1 s, and the answer tells its outcome; an answer may take 0.5 s.
            self._soon(self._forget_cleared).join(0.2)
        return {"intercepted": self._interception.intercepted, "plan": None, "former": status.plan_row(former)}

    def _forget_cleared(self) -> None:
        if self._interception.plan is None:
            self._interception.set_plan(None)

    def _soon(self, change: Callable[[], object]) -> threading.Thread:
        """Make a change when no other is in progress; return the thread that does."""

        def make() -> None:
            try:
                with self._changing:
                    if not self._closed:
                        change()
            except RiotError:
                _LOG.exception("what is left of an urgent command could not be done")

        thread = threading.Thread(target=make, name="riot-soon", daemon=True)
        thread.start()
        return thread

    def record_start(self, path: str | None = None) -> dict[str, Any]:
        """Record all that passes from now on.

        Args:
            path: Path relative to the folder of recordings; None for a name with the present time.

        Raises:
            ConfigError: It records already, or the path leads elsewhere or exists.
        """
        with self._changing:
            return {"file": str(self._recordings.start(path))}

    def record_stop(self) -> dict[str, Any]:
        """End the recording, at once, and return its figures; raises ConfigError if there is none."""
        figures = self._recordings.stop()[1]
        self._soon(self._recordings.settle)
        return figures

    def record_split(self, path: str | None = None) -> dict[str, Any]:
        """Continue recording in another file, without losing or repeating a message; `path` as for `record_start`."""
        former, present = self._recordings.split(path)
        return {"former": str(former), "file": str(present)}

    def shutdown(self) -> None:
        """Ask the process that runs this router to end."""
        self.stopping.set()

    # -- what is going on ---------------------------------------------------------------------------------------------

    @property
    def topics(self) -> list[str]:
        """What is intercepted, as it was written."""
        return self._interception.topics

    @property
    def bus(self) -> Bus:
        """The bus; raises EnvironmentFaultError before it is open."""
        if self._bus is None:
            raise EnvironmentFaultError("this router is not open", hint="use it in a with statement")
        return self._bus

    @property
    def endpoints(self) -> dict[str, tuple[str, ...]]:
        """Where components of each segment connect, to be shown."""
        bus = self.bus
        return {name: status.shown_endpoints(bus.segment(name)) for name in self.settings.segments}

    def status(self) -> dict[str, Any]:
        """Return the complete status, as JSON values."""
        bus = self.bus
        counts = status.count_rows(bus.counts())  # first: interceptors are told of some messages only then
        return {
            "name": self.settings.name,
            "version": __version__,
            "pid": os.getpid(),
            "uptime": round(time.monotonic() - self._began, 3),
            "segments": status.segment_rows(bus, self.graph()),
            "controlled_from": list(self.settings.controlled_from),
            "intercepted": [self._registry.topic(each) for each in bus.intercepted],
            "services": [self._registry.topic(each) for each in bus.services],
            "interceptors": status.interceptor_rows(bus.executor.pipeline),
            "plan": status.plan_row(self._interception.plan),
            "recording": self._recordings.status(),
            "counts": counts,
            "losses": status.loss_rows(bus.losses),
            "departures": bus.departures,
            "bypasses": status.bypass_rows(self._watches.bypasses if self._watches is not None else ()),
            "warnings": self.warnings,
        }

    def graph(self) -> Graph:
        """Return who talks to whom; an empty graph before `watch`."""
        from riot_bus.graph.model import Graph

        return self._watches.graph if self._watches is not None else Graph()

    def graph_document(self) -> dict[str, Any]:
        """Return the graph as JSON values, with its age in seconds; None before `watch`."""
        from riot_bus.graph.render import VERSION as GRAPH_VERSION

        age = self._watches.graph_age if self._watches is not None else None  # before the graph: never too young
        return {"version": GRAPH_VERSION, "age": age, **asdict(self.graph())}

    def _metadata(self) -> dict[str, str]:
        segments = (f"{name}={','.join(map(redacted, each.listen))}" for name, each in self.settings.segments.items())
        metadata = {"router": self.settings.name, "seed": str(self._seed), "segments": " ".join(segments)}
        plan = self._interception.plan
        return metadata | ({"plan": plan.text} if plan is not None else {})


def _counts(service: RouterService, request: CommandRequest) -> dict[str, Any]:
    return {"counts": status.count_rows(service.bus.counts()), "losses": status.loss_rows(service.bus.losses)}


ROUTER_COMMANDS: dict[str, Command] = {
    "status": Command(lambda service, _: service.status(), reads=True, urgent=True),
    "counts": Command(_counts, reads=True),
    "graph": Command(lambda service, _: service.graph_document(), reads=True),
    "intercept/add": Command(lambda service, request: {"intercepted": service.intercept_add(request.keys())}),
    "intercept/remove": Command(lambda service, request: {"intercepted": service.intercept_remove(request.keys())}),
    "plan/load": Command(lambda service, request: service.plan_load(request.text(), request.name())),
    "plan/clear": Command(lambda service, _: service.plan_clear(), urgent=True),
    "record/start": Command(lambda service, request: service.record_start(request.path())),
    "record/stop": Command(lambda service, _: service.record_stop(), urgent=True),
    "record/split": Command(lambda service, request: service.record_split(request.path())),
}
"""All commands by name."""
