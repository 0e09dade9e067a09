"""The setup of one trial: its segments, its components, and the view that monitors judge."""

from __future__ import annotations

import functools
import logging
import os
import signal
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self, Unpack

from riot_bus.monitors.model import NO_SIGNS, ComponentView, ResourceSample, Signs, TrialView
from riot_bus.processes.activity import (
    STILL,
    Activity,
    Idle,
    Threads,
    families,
    idle_between,
    out_of_memory_kills,
    resources,
)
from riot_bus.processes.launcher import TORN_DOWN_WITHIN_S
from riot_bus.processes.python_report import MainEnd, PythonReport, ThreadStack
from riot_bus.processes.resource_limits import amount_text
from riot_bus.router.bus import Bus
from riot_bus.router.services.offer import ServiceOffer
from riot_bus.trial.kept_network import KeptNetwork
from riot_bus.trial.settling import all_wait, is_at_rest, own_others, own_senders, wait_settled
from riot_bus.trial.starter import ComponentStarter, last_words
from riot_bus.vocabulary.errors import EnvironmentFaultError, PayloadError
from riot_bus.vocabulary.message import Qos
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, MutableMapping, MutableSequence, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from riot_bus.pipeline.runner import Pipeline
    from riot_bus.processes.launcher import ComponentProcess, Launcher
    from riot_bus.router.services.recorded import RecordedService
    from riot_bus.system.system_file import Ready, RunPace
    from riot_bus.trial.context import Context
    from riot_bus.trial.settling import RestOptions
    from riot_bus.vocabulary.message import Message, Scalar
    from riot_bus.zenoh.network import Network

Watch = Callable[[str, Callable[["Message"], None]], None]
"""Function that subscribes a callback to the messages of a key expression."""

_LOG = logging.getLogger(__name__)
_ANY_PORT = ("tcp/127.0.0.1:0",)
_POLL = 0.002
_KILLED_WITHIN = 10.0
"""Seconds; a process that waits for a disk or a device dies late."""
_MEASURE = 0.15
"""Longer than 0.1 s, after which each of Zenoh's threads for callbacks in Python wakes up."""
_MEASURED, _STILL = 3, 0.03
"""Number of measurements for components that are started in the same way, and the window of rest, in seconds, that
they have to keep once it is known, as long as the default of `settle.window`."""
_WATCH, _WINDOWS = 0.5, 3
"""Seconds in which a timer that matters comes once, and how often it is looked for: a start may leave something to do
in the first of them, Zenoh's sign of life (5 to 8 switches each 2.5 s) falls into one."""
_LITTLE = 0.03
"""Of a processor: a program that starts takes most of one, Zenoh's threads a tenth of this."""
_ALIKE = 0.2  # timers do about the same each time, a start does not; a guess


@dataclass(frozen=True, slots=True)
class TrialPlace:
    """The place of a trial: system, launcher, folder, and what is kept between trials.

    Attributes:
        context: Context of the system.
        launcher: Owner of the processes.
        directory: Folder in which files may be left.
        imports: Modules that Python components import, by program (see `TrialSetup`); trials fill it.
        kept: Units and systems that are kept over trials.
        network: Segments that stay open between trials.
    """

    LEFT = "left"
    """Name in the folder of what a trial is asked to leave: a folder of evidence, or a recording."""

    context: Context
    launcher: Launcher
    directory: Path
    imports: MutableMapping[str, Sequence[str]]
    kept: MutableSequence[AbstractContextManager[object]] = field(default_factory=list)
    network: KeptNetwork = field(default_factory=KeptNetwork)

    @property
    def left(self) -> Path:
        """Path of the evidence or recording that a trial is asked for."""
        return self.directory / self.LEFT

    def setup(
        self,
        *,
        segments: Sequence[str],
        context: Context | None = None,
        directory: Path | None = None,
        **options: Any,
    ) -> TrialSetup:
        """Return a setup in this place.

        Args:
            segments: Names of the segments, as for `TrialSetup`.
            context: The system, if it is another one than that of the place.
            directory: Folder, if it is another one.
            options: Further arguments of `TrialSetup`.
        """
        given: dict[str, Any] = {"imports": self.imports, "network": self.network, **options}
        context, directory = context or self.context, directory or self.directory
        return TrialSetup(context, self.launcher, directory, segments=segments, **given)


class TrialSetup:
    """Segments of their own for components, and the components; a context manager that leaves nothing behind.

    Args:
        context: Context of the system.
        launcher: Owner of the processes.
        directory: Folder for their output and for what they write to `{trial_dir}`.
        segments: Names of the segments; empty for one segment for each component, with its name.
        intercept: Key expressions that are cut and passed through `pipeline`.
        pipeline: Pipeline of the interceptors.
        stall: Seconds after which a component that takes no messages loses its link.
        imports: Modules that Python components import, by the component's name, folder and command, since a unit alone
            may have another command; components that are not in it are executed and added, others are forked.
        attach: Components of the trial; if one runs already, its segment listens on the address that it connects to.
        network: Network that is kept between trials; without it, segments are opened and closed.

    Attributes:
        idle: Activity of components that are ready and never rest; no activity if they rest.
        senders: Threads of this process that send.
        others: All threads of this process except the one that runs the trial.
        now: Function that returns the time of published messages, in nanoseconds.
        services: Recorded services that answer the calls of components.
        begun: Start of the trial, in seconds of the monotonic clock.
    """

    def __init__(
        self,
        context: Context,
        launcher: Launcher,
        directory: Path,
        *,
        segments: Sequence[str],
        intercept: Sequence[str] = (),
        pipeline: Pipeline | None = None,
        stall: float = 10.0,
        parameters: Mapping[str, Scalar] | None = None,
        imports: MutableMapping[str, Sequence[str]] | None = None,
        attach: Iterable[str] = (),
        network: KeptNetwork | None = None,
    ) -> None:
        self.context = context
        self.launcher = launcher
        self.directory = directory
        self.processes: dict[str, ComponentProcess] = {}
        self._families: dict[tuple[int, ...], Threads] = {}
        self.outputs: list[Message] = []
        self.inputs: list[Message] = []
        self.services: list[RecordedService] = []
        self.python = PythonReport(directory)
        self._samples: dict[str, list[ResourceSample]] = {}
        self._published: set[str] = set()
        self._offers: dict[str, ServiceOffer] = {}
        self._watched: list[str] = []
        self._started: dict[str, float] = {}
        self._as: dict[str, str] = {}
        self.idle = STILL
        nominal = {name: each.nominal for name, each in context.file.external.parameters.items()}
        self._parameters = {**nominal, **(parameters or {})}
        self._starter = ComponentStarter(
            context,
            launcher,
            directory,
            python=self.python,
            imports={} if imports is None else imports,
            parameters=self._parameters,
        )
        self.senders, self.others = own_senders(), own_others()
        self._apart = not segments
        self._attached_at: set[str] = set()
        addresses = self._addresses(segments, attach)
        self._kept = network if not self._attached_at else None
        self._network: Network | None = None
        if self._kept is not None:
            self._network = self._kept.take(list(addresses), intercept, wait_before_close_s=stall)
        self.bus = Bus(
            self._network or addresses,
            intercept=intercept,
            pipeline=pipeline,
            registry=context.registry,
            wait_before_close_s=stall,
        )
        self.now: Callable[[], int] = time.time_ns
        self._begin, self.begun = time.time_ns(), time.monotonic()
        self._killed = out_of_memory_kills()

    def _addresses(self, segments: Sequence[str], attach: Iterable[str]) -> dict[str, tuple[str, ...]]:
        """Return where each segment listens: on any port, and where components connect to that run already."""
        found: dict[str, tuple[str, ...]] = dict.fromkeys(segments or self.context.file.components, _ANY_PORT)
        for name in attach:
            if (address := self.context.file.components[name].attach) is not None:
                found[self.segment_of(name)] = (*found[self.segment_of(name)], address)
                self._attached_at.add(address)
        return found

    def _endpoint(self, segment: str) -> str:
        """Return where components of a segment connect that are started."""
        return next(each for each in self.bus.segment(segment).endpoints if each not in self._attached_at)

    def segment_of(self, name: str) -> str:
        """Return the segment that a component connects to."""
        return name if self._apart else self.context.file.segment_of(self.context.file.components[name])

    def __enter__(self) -> Self:
        try:
            self.bus.open()
        except BaseException:
            self._give_back(usable=False)
            raise
        return self

    def __exit__(self, error: object, *_: object) -> None:
        usable = False
        try:
            for name in self.processes:
                self._terminate(name)
            self.launcher.kill_all()
            for threads in self._families.values():
                threads.close()
            for offer in self._offers.values():
                offer.close()
        finally:
            try:
                self._starter.close()
                usable = error is None and not self.bus.losses.links
            finally:
                try:
                    self.bus.close()
                finally:
                    self._give_back(usable=usable)

    def _give_back(self, *, usable: bool) -> None:
        if self._kept is not None and self._network is not None:
            self._kept.give_back(self._network, usable=usable)

    def renew(self) -> None:
        """Begin another trial with the same processes, and discard the observations of the last one."""
        self._begin, self.begun = self.now(), time.monotonic()
        self.outputs, self.inputs, self._samples = [], [], {}
        self._watched.clear()
        for service in self.services:
            service.restart()
        for process in self.processes.values():
            for path in (process.stdout, process.stderr):
                os.truncate(path, 0)

    def start(
        self, name: str, *, seed: int, pace: RunPace | None = None, before: Sequence[str] = ()
    ) -> ComponentProcess:
        """Start a component on its segment.

        Args:
            name: Name of the component.
            seed: Value of `{seed}`.
            pace: Values of `{duration}` and `{speed}`.
            before: Words before its command, such as those of a debugger.
        """
        ready, segment = self.context.file.components[name].ready, self.segment_of(name)
        if ready.topic is not None:
            told = parse_selector(ready.topic)
            for expression in self.context.topics(told.topic):
                self.bus.subscribe(segment, expression, functools.partial(self._hear, name, told.where))
        if ready.service is not None and name not in self._offers:
            self._offers[name] = ServiceOffer(self.bus.segment(segment).session, ready.service, self.context.registry)
        process = self._starter.start(
            name, self._endpoint(segment), segment=segment, seed=seed, pace=pace, before=before
        )
        self._started[name] = time.monotonic()
        self._as[name] = repr((name, self.context.file.components[name].command, before, pace, self._parameters))
        self.processes[name] = process
        return process

    def execute(self, name: str, command: Sequence[str], *, timeout: float) -> None:
        """Execute a command of riot.toml to its end, such as one that resets components.

        Raises:
            ConfigError: It fails.
            EnvironmentFaultError: It cannot be executed, or takes longer than `timeout` seconds.
        """
        self._starter.execute(name, command, timeout=timeout)

    def end(self, names: Iterable[str]) -> None:
        """End components, as `stop` in riot.toml asks for.

        Raises:
            EnvironmentFaultError: One cannot be ended.
        """
        for name in names:
            self._terminate(name)
            process = self.processes[name]
            if self.launcher.alive(process):
                self.launcher.interrupt(process, signal.SIGKILL)
            if not self.launcher.wait([process], timeout=_KILLED_WITHIN):
                raise EnvironmentFaultError(f"component {name!r} cannot be killed")
            self.launcher.wait([process], timeout=TORN_DOWN_WITHIN_S, torn_down=True)

    def _terminate(self, name: str) -> None:
        """Give a component time to end by itself, if riot.toml says so."""
        process, stop = self.processes[name], self.context.file.components[name].stop
        if stop == "kill" or not self.launcher.alive(process):
            return
        if stop != "term":
            if problem := self._starter.stop(name):
                _tell_unstopped(name, f"{stop[0]!r} {problem}")
            return
        self.launcher.interrupt(process, signal.SIGTERM)
        self.launcher.wait([process], timeout=3.0)

    def wait_subscribed(self, name: str, keys: Iterable[str]) -> None:
        """Wait until the only component on its segment has subscribed to keys.

        Raises:
            EnvironmentFaultError: It died before, or did not subscribe in time.
        """
        segment, timeout = self.segment_of(name), self.context.file.components[name].ready.timeout
        missing = self.bus.wait_subscribed(segment, list(keys), timeout=timeout, alive=lambda: self._starter.runs(name))
        self._check_alive([name])
        if missing:
            topic = self.context.registry.topic(missing[0])
            raise self._did_not_start(name, f"has not subscribed to {topic} within {timeout:g} s")
        self._wait_declared([name])
        self._watch([name])

    def wait_ready(self, names: Iterable[str]) -> None:
        """Wait until components have connected and come to rest, so whatever they declare at start is declared.

        Nodes behind a bridge may be at rest and not known yet, so declared inputs are waited for as well; one
        without a subscriber is not an error.

        Raises:
            EnvironmentFaultError: One died before, or they did not connect in time.
        """
        names = list(names)
        components = {name: self.context.file.components[name] for name in names}
        timeout = max((component.ready.timeout for component in components.values()), default=0.0)
        deadline = time.monotonic() + timeout
        for segment in set(map(self.segment_of, names)):
            here = [name for name in names if self.segment_of(name) == segment]
            while len(self.bus.segment(segment).peers() - self.bus.ids) < len(here):
                self._check_alive(names)
                if time.monotonic() > deadline:
                    what = f"has not connected to {self.bus.endpoint(segment)} within {timeout:g} s"
                    raise self._did_not_start(here[-1], f"(or another of {', '.join(here)}) {what}")
                time.sleep(_POLL)
            inputs = self.context.topics(*sorted({topic for name in here for topic in components[name].inputs}))
            self.bus.wait_subscribed(
                segment,
                inputs,
                timeout=deadline - time.monotonic(),
                alive=lambda: all(map(self._starter.runs, names)),
            )
        self._wait_declared(names)
        self._watch(names)
        self._come_to_rest(names, deadline)
        self._check_alive(names)

    def _watch(self, names: Iterable[str]) -> None:
        """Record native stacks at fatal signals from now on, and find components whose processes are elsewhere."""
        for name in names:
            self._starter.find_inside(name)
        traced = [self.processes[name].pid for name in names if self.context.file.components[name].is_process]
        if traced and (cannot := self.launcher.watch(traced)):
            _tell_unwatched(cannot)

    def _hear(self, name: str, where: str | None, message: Message) -> None:
        """Note that a component has published what its `ready` asks for."""
        kind = self.context.registry.type_of_message(message)
        with suppress(PayloadError, TypeError):  # the field is not there, or is of another type
            if where is None or (kind and parse_predicate(where)(lambda path: kind.read(message.payload, path))):
                self._published.add(name)

    def _wait_declared(self, names: Iterable[str]) -> None:
        """Wait for what `ready` in riot.toml asks for."""
        for name in names:
            ready = self.context.file.components[name].ready
            while (missing := self._not_ready(name, ready)) is not None:
                self._check_alive([name])
                if time.monotonic() - self._started[name] > ready.timeout + ready.after:
                    raise self._did_not_start(name, f"{missing} within {ready.timeout:g} s")
                time.sleep(_POLL)

    def _not_ready(self, name: str, ready: Ready) -> str | None:
        """Return what is still missing of what `ready` asks for; None if nothing is."""
        process = self.processes[name]
        if self.context.file.components[name].attach is not None and not process.printed().endswith("\n"):
            return "has not connected, or is not a process of this machine that this user may inspect"
        if ready.line is not None and ready.line not in process.printed() and ready.line not in process.errors():
            return f"has not printed {ready.line!r}"
        if ready.topic is not None and name not in self._published:
            return f"has not published on {ready.topic}"
        if ready.service is not None and not self._offers[name].there():
            return f"does not offer the service {ready.service}"
        if ready.port is not None:
            port = ready.port if isinstance(ready.port, int) else self._starter.free_port(ready.port)
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)):
                    return f"does not listen on port {port}"
        if time.monotonic() - self._started[name] < ready.after:
            return f"is not ready before {ready.after:g} s"
        return self._starter.why_not_ready(name)

    def _come_to_rest(self, names: Sequence[str], deadline: float) -> None:
        """Wait until components do next to nothing, or as much as the moment before because of their own timers.

        Their activity then is `idle`, by which work is recognised later. It is measured for longer than after the last
        input; else a pause between two timers would be taken for rest, and no pause as long might come at the end.
        Nor may a thread of the router wait for a processor: it may have a subscription to process that the component
        has declared, and of several subscribers of a key, only the first one is waited for elsewhere.

        Once it has been measured in three trials, components that are started in the same way only have to stand still
        as after an input.
        """
        last: Idle | None = None
        known = self.context.idle["; ".join(self._as[name] for name in names)]
        if len(known) >= _MEASURED:
            self.idle = sorted(known, key=lambda each: each.switches)[_MEASURED // 2]
            while (left := deadline - time.monotonic()) > 0:
                if self.settle(names, window=_STILL, timeout=left, idle=self.idle) and not self.wants_processor(names):
                    return
        while time.monotonic() < deadline:
            self.include_started(names)
            now = self.measure_idle(names, seconds=_MEASURE)
            self.idle = now if last is None else now.or_more(last)
            alike = last is not None and abs(now.switches - last.switches) <= _ALIKE * now.switches
            if (now.ran <= _LITTLE or alike) and not self.wants_processor(names):
                known.append(self.idle)
                return
            last = now

    def _check_alive(self, names: Iterable[str]) -> None:
        for name in names:
            self._starter.check_way(name)
            if not self.launcher.alive(self.processes[name]):
                status = self.processes[name].status
                raise self._did_not_start(name, f"ended with status {status} before it was ready")

    def _excess(self, name: str) -> tuple[str, str] | None:
        """Return the resource whose limit ended a component, with a text about the amount; None if none did."""
        excess, limits = self.processes[name].excess, self.context.file.components[name].limits
        if excess is None or limits == "off":
            return None
        what, had = excess
        most = amount_text(what, getattr(limits, what))
        return what, f"it had {what} of {amount_text(what, had)}, and [components.{name}] limits it to {most}"

    def _did_not_start(self, name: str, what: str) -> EnvironmentFaultError:
        if excess := self._excess(name):
            hint = f"write limits = {{ {excess[0]} = ... }} with more than that if it is right"
            return EnvironmentFaultError(
                f"component {name!r} was ended before it was ready: {excess[1]}",
                where=str(self.context.file.path),
                hint=hint,
            )
        hint = last_words(self.processes[name])
        return EnvironmentFaultError(f"component {name!r} {what}", where=str(self.context.file.path), hint=hint)

    def linger(self, names: Sequence[str], *, seconds: float, timeout: float) -> None:
        """Give components that are at rest time to die.

        A process that ends with an exception is quiet while its session closes (100 ms and more were seen, with a full
        queue), and looks the same from outside as one that has nothing to do. Of Python programs it is known.
        """
        processes = [self.processes[name] for name in names]
        if all(self.python.goes_on(process.pid) for process in processes):
            return
        begin, held_up = time.monotonic(), self.held_up(names)
        while all(map(self.launcher.alive, processes)) and time.monotonic() - begin - held_up() < seconds:
            time.sleep(_POLL)
        segments = set(map(self.segment_of, names))
        if not any(self.bus.segment(segment).peers() - self.bus.ids for segment in segments):
            self.launcher.wait(processes, timeout=timeout)  # all have closed their sessions, so they are ending

    def watch_outputs(self, topics: Iterable[str], watch: Watch) -> None:
        """Collect the messages of some topics for the monitors, each once though several of the topics have it.

        Args:
            topics: Names of the topics.
            watch: Function that subscribes to a segment.
        """
        for expression in self.context.topics(*topics):
            earlier = tuple(self._watched)

            def take(message: Message, earlier: Sequence[str] = earlier) -> None:
                if not any(self.context.registry.matches(each, message.key) for each in earlier):
                    self.outputs.append(message)

            self._watched.append(expression)
            watch(expression, take)

    def watch_all_outputs(self, *, segment: str, inputs: Iterable[str]) -> None:
        """Collect whatever components publish on a segment, but for some topics."""
        registry, inputs = self.context.registry, tuple(inputs)
        known: dict[str, bool] = {}

        def take(message: Message) -> None:
            if message.key not in known:
                known[message.key] = not any(registry.matches(topic, message.key) for topic in inputs)
            if known[message.key]:
                self.outputs.append(message)

        self.bus.subscribe(segment, "**", take, own=False)

    def put(self, segment: str, message: Message, *, batched: bool = False) -> None:
        """Publish an input; it waits if receivers are slow.

        Args:
            segment: Name of the segment.
            message: Message to publish.
            batched: Whether messages that follow at once may share a packet with it, even if it is an express message.
                A packet for each took half of the time of a trial with thousands of messages.
        """
        sent = message.sent(self.now(), _blocking(message.qos.priority, message.qos.express and not batched))
        self.bus.put(segment, sent)
        self.inputs.append(sent)

    def is_at_rest(self, name: str, *, since: Activity, own: Activity, window: float) -> bool:
        """Return whether a component certainly does nothing more without input, and all its outputs have arrived.

        True for Python programs only: any other program that is ending is quiet, too, while it closes its session.

        Args:
            name: Name of the component.
            since: Activity of the component before its input.
            own: Activity then of the other threads of this process, which send and receive.
            window: Seconds within which no timer of Zenoh's may be due.
        """
        threads = self.threads([name])
        return (
            len(threads.pids) == 1
            and is_at_rest(threads, since=since, window=window)
            and all_wait(self.others, since=own, window=window)
            and self.bus.idle()
            and self.python.goes_on(self.processes[name].pid)
        )

    def sample_resources(self, names: Iterable[str]) -> None:
        """Note the resources that components use now."""
        for name in names:
            bridge = self._starter.bridge_of(name)
            ours = families([bridge.pid]) if bridge is not None else ()
            own = [pid for pid in self._family([name]) if pid not in ours]
            sample = resources(own, messages=len(self.inputs))
            self._samples.setdefault(name, []).append(sample)

    def samples(self, name: str) -> Sequence[ResourceSample]:
        """Return the noted resources of a component over time."""
        return self._samples.get(name, ())

    def stacks(self, names: Iterable[str]) -> list[ThreadStack]:
        """Ask Python components where their threads stand; empty for others."""
        return self.python.stacks(self._family(names))

    def main_end(self, name: str) -> MainEnd | None:
        """Return how the main thread of a Python component has ended; None if it has not, or for other programs."""
        return self.python.main_end(self._family([name]))

    def activity(self, names: Iterable[str]) -> Activity:
        """Return how busy components have been so far."""
        return self.threads(names).activity()

    def measure_idle(self, names: Iterable[str], *, seconds: float) -> Idle:
        """Measure the activity of components for some seconds."""
        names = list(names)
        begin, before = time.monotonic(), self.activity(names)
        time.sleep(seconds)
        return idle_between(before, self.activity(names), seconds=time.monotonic() - begin)

    def measure_timers(self, names: Iterable[str]) -> Idle:
        """Return what ready components do because of timers of their own; nothing once there is nothing for a while."""
        names, found = list(names), list[Idle]()
        while len(found) < _WINDOWS and all(each.switches for each in found):
            found.append(self.measure_idle(names, seconds=_WATCH))
        return min(found, key=lambda each: each.switches)

    def held_up(self, names: Iterable[str], *, since: tuple[Activity, Activity] | None = None) -> Callable[[], float]:
        """Return a function that tells how many seconds components, or the router here, waited for a processor since.

        A wait counts when it is over: see `wants_processor`.

        Args:
            names: Names of the components.
            since: Activity of the components and of the router here at the start; None to start now.
        """
        looked_at = self.threads(names), self.others
        before = since or [threads.activity() for threads in looked_at]
        return lambda: max(now.activity().waited_since(then) for now, then in zip(looked_at, before, strict=True))

    def wants_processor(self, names: Iterable[str]) -> bool:
        """Return whether components, or the router here, run or would if they had a processor."""
        return self.threads(names).busy() or self.others.busy()

    def threads(self, names: Iterable[str]) -> Threads:
        """Return the threads of components and of what they had started when they were last waited for."""
        pids = self._starter.roots(names)
        if pids not in self._families:
            self._families[pids] = Threads(families(pids))
        return self._families[pids]

    def include_started(self, names: Iterable[str]) -> bool:
        """Include processes that components have started meanwhile; return whether there are no changes."""
        pids = self._starter.roots(names)
        known = self._families.get(pids)
        if known is not None and known.has_all_of(pids):
            return True
        now = families(pids)
        if known is not None and set(known.pids) == set(now):
            return True
        if known is not None:
            known.close()
        self._families[pids] = Threads(now)
        return False

    def _family(self, names: Iterable[str]) -> Sequence[int]:
        return self.threads(names).pids

    def settle(self, names: Sequence[str], *, timeout: float, **options: Unpack[RestOptions]) -> bool:
        """Wait until components stand still or one has died, as `wait_settled` does; False if they stay busy.

        Raises:
            EnvironmentFaultError: The machine was too busy for them.
        """
        processes = [self.processes[name] for name in names]
        deadline = time.monotonic() + timeout
        while True:
            self.include_started(names)
            settled = wait_settled(
                self.threads(names),
                timeout=max(0.0, deadline - time.monotonic()),
                alive=lambda: all(map(self.launcher.alive, processes)),
                **options,
            )
            if not settled or self.include_started(names):  # else they may still be starting others
                return settled

    def view(
        self, names: Sequence[str], *, settled: bool, waited: float, signs: Mapping[str, Signs] | None = None
    ) -> TrialView:
        """Return what the monitors judge, for these components.

        Args:
            names: Names of the components.
            settled: False when they were still busy at the deadline.
            waited: That deadline, seconds.
            signs: Differences of each component from nominal trials.
        """
        views = []
        for name in names:
            component = self.context.file.components[name]
            process = self.processes[name]
            self.launcher.alive(process)
            self._starter.check_way(name)
            if process.status == -signal.SIGKILL and process.excess is None and out_of_memory_kills() > self._killed:
                hint = "run fewer trials at once (--jobs), or write limits with less memory"
                raise EnvironmentFaultError(f"the kernel has ended {name!r}: the machine has no memory left", hint=hint)
            root = self._starter.folder_of(name)
            traced = component.tracebacks == "fail"
            seen = (signs or {}).get(name, NO_SIGNS)
            if component.attach is not None and process.status is not None:  # its status is not known
                seen = replace(seen, ended="its process has ended")
            views.append(
                ComponentView(
                    name,
                    process.status,
                    process.errors(),
                    root,
                    traced,
                    printed=process.printed(),
                    stack=process.stack,
                    resources=tuple(self.samples(name)),
                    signs=seen,
                    excess=self._excess(name),
                    unread=process.unread,
                )
            )
        losses = self.bus.losses
        if settled and (late := losses.reasons.get("observer too slow")):  # else it publishes without an end
            hint = "run fewer trials at once (--jobs), or stop what else runs on this machine"
            raise EnvironmentFaultError(f"{late} outputs came faster than they could be taken in", hint=hint)
        broken = {link.segment for link in losses.links if link.reason == "stalled"}
        stalled = [name for name in names if self.segment_of(name) in broken]
        return TrialView(
            views,
            settled,
            waited,
            self.context.registry,
            tuple(self.outputs),
            self._begin,
            self.now(),
            stalled,
            tuple(self.inputs),
        )


@functools.cache
def _blocking(priority: int, express: bool) -> Qos:  # noqa: FBT001 - a cached function
    return Qos(priority, "block", express)


@functools.cache
def _tell_unwatched(why: str) -> None:
    _LOG.warning("crashes by a signal are told apart by the signal alone: components cannot be traced (%s)", why)


@functools.cache
def _tell_unstopped(name: str, what: str) -> None:
    _LOG.warning("component %r is killed: its stop command %s", name, what)
