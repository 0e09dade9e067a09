"""One run of the whole system: what drives it, what is seen of it, and how it comes to rest."""

from __future__ import annotations

import functools
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from riot_bus.inject.apply import changed_by, inject_log
from riot_bus.inject.interceptor import Injector
from riot_bus.log.playback.player import play
from riot_bus.log.writer import LogWriter
from riot_bus.monitors.liveness import LIVENESS
from riot_bus.monitors.model import NO_SIGNS, judge
from riot_bus.system.system_file import RunPace, Settle
from riot_bus.trial.baseline import UNKNOWN, Baseline
from riot_bus.trial.node_parameters import set_parameters
from riot_bus.trial.observation import MEASURE_S
from riot_bus.trial.running_system import VirtualTimeSystem
from riot_bus.trial.scarce import held
from riot_bus.trial.settling import POLL
from riot_bus.trial.signs import Feeder
from riot_bus.vocabulary.clock import SystemClock
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.pipeline.event import Event
    from riot_bus.processes.activity import Activity
    from riot_bus.system.system_file import SystemFile
    from riot_bus.trial.context import Context
    from riot_bus.trial.network import Subscribe
    from riot_bus.trial.running_system import RealTimeSystem
    from riot_bus.trial.setup import TrialPlace, TrialSetup
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.message import Scalar
    from riot_bus.vocabulary.trial import TestCase, Violation

_UNIT_SETTLE = Settle()
"""Settings of units; systems have none of their own."""
_PATIENCE = 3.0  # a loaded machine may run external components at a third of the pace; a guess


@dataclass(frozen=True, slots=True)
class RunSettings:
    """What a run is like, and what is done with it.

    Attributes:
        observe: Fields (`topic:field`) whose values are kept, and topics of which only the times are kept.
        record: Whether every message of the run is written into the file `TrialPlace.left`.
        unit: Unit that is judged as in a unit trial; empty for none.
        baseline: Behaviour of the unit in nominal runs of the whole system.
        nominal: Whether to measure the baseline.
        evidence: Whether a failing run leaves evidence in `TrialPlace.left`.
    """

    pace: RunPace
    observe: tuple[str, ...] = ()
    record: bool = False
    unit: str = ""
    baseline: Baseline = UNKNOWN
    nominal: bool = False
    evidence: bool = False

    def metadata(self, case: TestCase, context: Context) -> dict[str, str]:
        """Return the metadata of a log of a run."""
        return {"system": context.file.system.name, "seed": str(case.seed), "duration": f"{self.pace.duration:g}"}


class SystemRun:
    """One run.

    Attributes:
        tap: The messages from outside.
        external: The messages from outside in order of time, once the run is over.
        inner: Observed messages of components inside, in order of reception.
        refused: Parameters whose value a running node has refused, each with the reason.
        alone: View of that component, once the run is over.
        begin: Time from which observed fields count, in nanoseconds.
    """

    def __init__(
        self, settings: RunSettings, case: TestCase, place: TrialPlace, system: RealTimeSystem | VirtualTimeSystem
    ) -> None:
        self._settings, self._case, self._place, self._system = settings, case, place, system
        self._context = context = place.context
        self._inside, self._outside, self._injections = roles_in(case, context.file)
        if self._injections and self._outside:
            context.file.check_outside_apart()
        self._injector = Injector(self._injections, seed=case.seed)
        self._virtual = system.time if isinstance(system, VirtualTimeSystem) else None
        self._messages: Sequence[Message] = case.messages
        if case.messages:
            self._messages, _ = inject_log(case.messages, self._injections, registry=context.registry, seed=case.seed)
        self.tap, self.external = OutsideTap(self._injector), list[Message]()
        self.inner: list[Message] = []
        self.refused: Mapping[str, str] = {}
        self.probe: Probe | None = None
        self.alone: TrialView | None = None
        self.begin = time.time_ns()
        if self._virtual:
            self.begin, self.tap.now = (self._messages or case.messages)[0].time, self._virtual.now

    def carry_out(self) -> TrialView:
        """Run the system, and return the view of it, without the component that the probe judges.

        Raises:
            EnvironmentFaultError: It cannot be judged.
        """
        system = self._system
        with ExitStack() as stack:
            stack.enter_context(held(self._context.file, self._outside) if system in self._place.kept else system)
            setup = system.setup
            system.begin([] if self._case.messages else [self._injector, self.tap], time=self.begin)
            self._observe(setup)
            if self._settings.record:
                stack.enter_context(self._recording(setup))
            system.start()
            self.refused = set_parameters(setup, self._inside, parameters_of(self._case))
            if self.probe:
                self.probe.begin()
            begun = setup.observation.begin(self._inside)
            played = self._play(setup) if self._case.messages else self._drive(setup)
            driven = setup.view(self._outside, settled=True, waited=_UNIT_SETTLE.timeout)
            self._end_outside(setup)
            settled = self._come_to_rest(setup, begun)
            if settled and not played and setup.processes.alive(self._inside):
                raise self._restless(setup)
            view = self._view(setup, settled=settled)
            held_up = 0.0 if self._virtual else setup.observation.held_up(self._inside, since=begun)()  # it waits
            self.external = sorted(self.tap.messages, key=lambda message: message.time)
            self.inner = list(self.inner)  # without what comes from now on
            if self.probe:
                self.alone = self.probe.end(settled=settled)
        components, stalled = [*view.components, *driven.components], [*view.stalled, *driven.stalled]
        return replace(view, components=components, stalled=stalled, held_up=held_up)

    def _observe(self, setup: TrialSetup) -> None:
        """Observe the inside, what drives it where that is not intercepted, and what monitors judge."""
        context, system = self._context, self._system
        subscribe = system.watching(context.file.segment_of(context.file.components[self._inside[0]]))
        controlled = context.file.external.topics
        internal = {parse_selector(text).topic for text in self._settings.observe} - set(controlled)
        matches = context.registry.matches
        internal = {topic for topic in internal if not any(matches(each, topic) for each in controlled)}
        for expression in context.topics(*sorted(internal)):
            subscribe(expression, self.inner.append)
        if not self._case.messages:
            for expression in context.topics(*sorted(set(controlled) - set(system.intercepted))):
                subscribe(expression, self.tap.observe)
        setup.network.watch_outputs(context.watched, subscribe)
        if self._settings.unit:
            self.probe = Probe(self._settings, setup, system.watching)

    def _recording(self, setup: TrialSetup) -> LogWriter:
        """Record every message into a file, which is to be closed."""
        context = self._context
        writer = LogWriter(
            self._place.left,
            registry=context.registry,
            profile=context.profile,
            metadata=self._settings.metadata(self._case, context),
        )
        subscribe = self._system.watching(context.file.segment_of(context.file.components[self._inside[0]]))
        subscribe("**", writer.write)
        return writer

    def _drive(self, setup: TrialSetup) -> bool:
        """Let the external components run to their end, or until something inside has died; return True.

        If all their commands contain {duration}, they end by themselves; otherwise they are stopped after that time.
        """
        pace, processes = self._settings.pace, setup.processes
        for name in self._outside:
            setup.start(name, seed=self._case.seed, pace=pace)
        commands = [setup.context.file.components[name].command for name in self._outside]
        ends = all(any("{duration}" in word for word in command) for command in commands)
        grace = _UNIT_SETTLE.timeout  # for their start and end, which take as long in short runs
        limit = _PATIENCE * pace.duration / pace.speed + grace if ends else pace.duration
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            if processes.wait(self._outside, timeout=5 * POLL) or not processes.alive(self._inside):
                return True
        if ends:
            late = ", ".join(repr(name) for name in self._outside if processes.started[name].status is None)
            raise EnvironmentFaultError(
                f"external component {late} has not ended within {limit:.0f} s",
                hint="its command has {duration} in it, so it is expected to end by itself",
            )
        return True

    def _play(self, setup: TrialSetup) -> bool:
        """Play messages; return False if, in virtual time, components did not come to rest before the end."""
        file, registry, names = setup.context.file, setup.context.registry, list(setup.processes.started)
        segments = {
            topic: file.segment_of(component)
            for component in file.components.values()
            if component.external
            for topic in component.outputs
        }
        elsewhere = next(iter(segments.values()), file.system.segments[0])

        def publish(message: Message) -> None:
            qos = Qos(message.qos.priority, "block", message.qos.express)
            self.tap.observe(message)
            segment = segments.get(registry.topic(message.key), elsewhere)
            setup.network.bus.put(segment, message.with_(qos=qos))

        def stop() -> bool:
            return not setup.processes.alive(names)

        if self._virtual:
            return self._virtual.play(self._messages, self.tap.observe, stop=stop)
        play(self._messages, publish, rate=1.0, clock=SystemClock(), stop=stop)
        return True

    def _end_outside(self, setup: TrialSetup) -> None:
        """End the external components, and wait for what injections delay."""
        setup.processes.end(self._outside)
        if self._outside and (latest := max((each.delay for each in self._injections), default=0.0)):
            setup.network.bus.drain(latest + _UNIT_SETTLE.timeout)

    def _come_to_rest(self, setup: TrialSetup, begun: tuple[Activity, Activity]) -> bool:
        """Wait until the components inside rest; return False if they are still busy at the deadline."""
        observation = setup.observation

        def certain() -> bool:
            return all(observation.is_at_rest(name, since=begun, window=_UNIT_SETTLE.window) for name in self._inside)

        rest = self.probe.feeder.rest if self.probe else observation.settle
        return rest(
            self._inside,
            window=_UNIT_SETTLE.window,
            timeout=_UNIT_SETTLE.timeout,
            idle=observation.idle,
            rests=certain if self._virtual else None,
        )

    def _view(self, setup: TrialSetup, *, settled: bool) -> TrialView:
        """Return the view of the components inside, but for the one that the probe judges."""
        settle, observation = _UNIT_SETTLE, setup.observation
        others = [name for name in self._inside if not self.probe or name != self.probe.name]
        rested = settled
        if self.probe and others and not settled:
            rested = observation.settle(others, window=settle.window, timeout=settle.timeout, idle=observation.idle)
        if settled:
            observation.linger(self._inside, seconds=settle.linger, timeout=settle.timeout)
        setup.network.bus.drain(settle.timeout)
        return setup.view(others, settled=rested, waited=settle.timeout)

    def _restless(self, setup: TrialSetup) -> EnvironmentFaultError:
        """Return the error for a run in virtual time that was not played to its end: a component never rests."""
        measure = functools.partial(setup.observation.measure_idle, seconds=MEASURE_S)
        busiest = max(self._inside, key=lambda name: measure([name]).switches)
        late = f"component {busiest!r} is not at rest after {_UNIT_SETTLE.timeout:g} s"
        return EnvironmentFaultError(
            f"{late}, so the log was not played to its end",
            where=f"{self._context.file.path}: system.clock",
            hint="virtual time is for components that act on messages and on the clock topic alone; leave `clock` out",
        )


class OutsideTap:
    """The last interceptor: keeps delivered messages with the time of delivery, and counts what injections changed."""

    def __init__(self, injector: Injector) -> None:
        self.messages: list[Message] = []
        self.now = time.time_ns
        self._injector, self._applied, self._changed = injector, Counter[int](), Counter[int]()

    def delivered(self) -> list[int]:
        """Return how many messages each injection has changed."""
        unseen = self._injector.hits - self._applied  # set in the bytes of all messages of a topic
        return [self._changed[number] + unseen[number] for number in range(len(self._injector.injections))]

    def message(self, event: Event) -> None:
        """Keep a message as it is delivered, if it is."""
        if applied := self._injector.hits - self._applied:
            self._changed.update(changed_by(self._injector.injections, applied, event.changes))
            self._applied += applied
        if not event.dropped:
            self.observe(event.message, later=event.delay_ns)

    def observe(self, message: Message, later: int = 0) -> None:
        """Keep a message that is delivered `later` nanoseconds from now."""
        self.messages.append(message.with_(time=self.now() + later))


class Probe:
    """Judges one component of a running system as in a unit trial: by its threads, and by its probe at the end.

    Attributes:
        feeder: Player of the probe; set by `begin`.
        statistics: Additional statistics for the outcome of a nominal trial.
    """

    def __init__(self, settings: RunSettings, setup: TrialSetup, watching: Callable[[str], Subscribe]) -> None:
        context, network = setup.context, setup.network
        self._settings, self._setup = settings, setup
        self._unit = context.file.unit[settings.unit]
        self.name = self._unit.component or settings.unit
        component = context.file.components[self.name]
        self._baseline = settings.baseline
        self._given: list[Message] = []
        self.feeder: Feeder
        self.statistics: dict[str, object] = {}
        watch = watching(network.segment_of(self.name))
        network.watch_outputs(sorted(settings.baseline.log_answers), watch)
        if settings.baseline.mined.rules:
            for expression in context.topics(*component.inputs):
                watch(expression, self._given.append)

    def begin(self) -> None:
        """Sample the component's resources and, in a nominal trial, its timers, before any external input."""
        self._setup.observation.sample_resources(self.name)
        if self._settings.nominal:
            idle = self._setup.observation.measure_timers([self.name])
            self._baseline = replace(self._baseline, idle=idle)
            self.statistics = {"switches": idle.switches, "ran": idle.ran}
        self.feeder = Feeder(self._setup, self.name, self._unit, self._baseline, ordered=self._baseline.ordered)

    def end(self, *, settled: bool) -> TrialView:
        """Play the probe, and return the view of the component; `settled` tells whether the system is at rest."""
        feeder, signs = self.feeder, NO_SIGNS
        if self._settings.nominal:
            seen = feeder.nominal(self._baseline.probe)
            settled = settled or feeder.works(seen)
        else:
            signs, settled = feeder.signs(settled=settled)
        waited = self._unit.settle.timeout
        view = self._setup.view([self.name], settled=settled, waited=waited, signs={self.name: signs})
        view = replace(view, probed=feeder.probed, inputs=[*self._given, *view.inputs])
        if self._settings.nominal:
            self.statistics["nominal"] = replace(seen, outputs=tuple(view.outputs), probed=view.probed)
        return view

    def judge(self, view: TrialView, *, seconds: float) -> tuple[Violation, ...]:
        """Return the violations of the component."""
        found = judge(view, [monitor() for monitor in LIVENESS]).violations
        self.feeder.end(hangs=any(each.monitor == "hang" for each in found), seconds=seconds)
        return (*found, *self._baseline.mined.judge(view))


def roles_in(case: TestCase, file: SystemFile) -> tuple[list[str], list[str], tuple[Injection, ...]]:
    """Return the components inside the system, the external ones that drive a case, and the injections into topics."""
    inside = [name for name, component in file.components.items() if not component.external]
    outside = [] if case.messages else [name for name in file.components if name not in inside]
    return inside, outside, tuple(each for each in case.injections if each.topic != PARAMETERS)


def parameters_of(case: TestCase) -> dict[str, Scalar]:
    """Return the parameters that a case sets."""
    return {
        str(each.field): each.value
        for each in case.injections
        if each.topic == PARAMETERS and isinstance(each.value, bool | int | float | str | bytes)
    }


def parameters_at_start(case: TestCase, file: SystemFile) -> dict[str, Scalar]:
    """Return the case's command-line parameters, without those that are set on running nodes."""
    return {name: value for name, value in parameters_of(case).items() if name not in file.external.in_nodes}
