"""One trial of the whole system: external topics intercepted, the inside observed (RIOT II-C, II-D)."""

from __future__ import annotations

import functools
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.inject.apply import changed_by, inject_log
from riot_bus.inject.interceptor import Injector
from riot_bus.log.playback.player import play
from riot_bus.log.writer import LogWriter
from riot_bus.monitors.liveness import LIVENESS
from riot_bus.monitors.model import NO_SIGNS, judge
from riot_bus.system.system_file import RunPace, Settle
from riot_bus.trial.baseline import UNKNOWN, Baseline
from riot_bus.trial.evidence import write_evidence
from riot_bus.trial.kept import end_kept
from riot_bus.trial.node_parameters import set_parameters
from riot_bus.trial.running_system import RealTimeSystem, VirtualTimeSystem, can_be_kept
from riot_bus.trial.scarce import held
from riot_bus.trial.signs import Feeder
from riot_bus.types.elements import read_field
from riot_bus.vocabulary.clock import SystemClock
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, PayloadError
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.vocabulary.trial import Outcome, Series, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.pipeline.event import Event
    from riot_bus.processes.activity import Activity
    from riot_bus.system.system_file import SystemFile
    from riot_bus.trial.context import Context
    from riot_bus.trial.stage import TrialPlace, TrialSetup, Watch
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.message import Scalar
    from riot_bus.vocabulary.trial import TestCase, Violation

EXTERNAL_LOG = "external.mcap"
_SETTLED = 0.03  # as the default of `settle.window` of units
_SETTLE_TIMEOUT = 10.0  # as the default of `settle.timeout` of units
_TICK = 0.02  # how late the death of a component inside is noticed; a look is one `select`
_PATIENCE = 3.0  # a loaded machine may run external components at a third of the pace; a guess
_GRACE = 10.0  # for their start and end, which take as long in short runs; a guess
_STALL = 60.0  # above `_SETTLE_TIMEOUT`: slow components that still read keep their links; a guess
_LOOK = 0.1  # only ranks components for an error; those that never rest switch within it


class _Tap:
    """The last interceptor: keeps delivered messages with the time of delivery, and counts what injections changed.

    Args:
        injector: The interceptor before it.
    """

    def __init__(self, injector: Injector) -> None:
        self.messages: list[Message] = []
        self.now = time.time_ns
        self._injector, self._applied, self._changed = injector, Counter[int](), Counter[int]()

    def delivered(self) -> list[int]:
        """Return how many messages each injection has changed."""
        unseen = self._injector.hits - self._applied  # set in the bytes of all messages of a topic
        return [self._changed[number] + unseen[number] for number in range(len(self._injector.injections))]

    def message(self, event: Event) -> None:
        if applied := self._injector.hits - self._applied:
            self._changed.update(changed_by(self._injector.injections, applied, event.changes))
            self._applied += applied
        if not event.dropped:
            self.observe(event.message, later=event.delay_ns)

    def observe(self, message: Message, later: int = 0) -> None:
        """Keep a message that is delivered `later` nanoseconds from now."""
        self.messages.append(message.with_(time=self.now() + later))


@dataclass(frozen=True, slots=True)
class SystemTrial:
    """Runs test cases against the whole system.

    In a case without messages, the system's own external components drive it, with injections applied to what they
    publish; a case with messages plays those instead of starting the external components.

    With a unit, one component is judged as in a unit trial: when the run is over and the external components have been
    ended, it gets its probe in place, among the other components.

    Attributes:
        observe: Fields (`topic:field`) whose values are kept, and topics of which only the times are kept.
        pace: Duration and speed of external components.
        record: Whether every message of the run is written into the file `TrialPlace.left`.
        unit: Unit that is judged as in a unit trial; empty for none.
        baseline: Behaviour of the unit in nominal runs of the whole system.
        nominal: Whether to measure the baseline: then `nominal` in the outcome's statistics is the `NominalTrial`, and
            `switches` and `ran` are the attributes of its `Idle`.
        evidence: Whether a failing run leaves evidence in `TrialPlace.left`.

    The outcome's statistics contain the number of messages that each injection changed (`delivered`), and their sum
    (`modified`), how many seconds a thread of the system waited for a processor (`held_up`), and the parameters whose
    value a running node has refused, each with the reason (`refused`).
    """

    pace: RunPace
    observe: tuple[str, ...] = ()
    record: bool = False
    unit: str = ""
    baseline: Baseline = UNKNOWN
    nominal: bool = False
    evidence: bool = False

    def run(self, case: TestCase, place: TrialPlace) -> Outcome:
        """Run the system once and judge it."""
        outcome = None
        try:
            outcome, again = self._carried_out(case, place)
            if again and outcome.verdict is not Verdict.PASS:
                end_kept(place)
                outcome, _ = self._carried_out(case, place)
        finally:
            if outcome is None or outcome.verdict is not Verdict.PASS:
                end_kept(place)
        return outcome

    def _carried_out(self, case: TestCase, place: TrialPlace) -> tuple[Outcome, bool]:
        """Return the outcome of a run, and whether its processes had been used for earlier runs."""
        started, again = time.monotonic(), False
        try:
            system = self._system(case, place)
            again = system.runs > 0
            return self._run(case, place, system, started), again
        except EnvironmentFaultError as error:
            return Outcome(Verdict.ERROR, seconds=time.monotonic() - started, detail=str(error)), again

    def _system(self, case: TestCase, place: TrialPlace) -> RealTimeSystem | VirtualTimeSystem:
        """Return the components for a run: those of earlier runs if they fit, else new ones."""
        file = place.context.file
        clock = file.system.clock if case.messages else None
        made: dict[str, Any] = {"seed": case.seed, "pace": self.pace, "parameters": _at_start(case, file)}
        goes_on = not (self.unit or self.record or self.evidence) and (clock is not None or can_be_kept(file, case))
        kind = RealTimeSystem if clock is None else VirtualTimeSystem
        system = next((each for each in place.kept if isinstance(each, kind)), None)
        if system and goes_on and system.fits(**made):
            return system
        end_kept(place)
        made |= {"timeout": _SETTLE_TIMEOUT, "stall": _STALL}
        if clock is not None:
            system = VirtualTimeSystem(place, clock, **made)
        else:
            inside, outside, injections = _cast(case, file)
            if not inside:
                raise ConfigError("all components are external, so there is no system to run", where=str(file.path))
            injected = set() if case.messages else {each.topic for each in injections}
            reset = file.system.reset if goes_on else None
            system = RealTimeSystem(place, inside, outside, sorted(injected), reset=reset, **made)
        if goes_on and system.may_go_on:
            place.kept.append(system.__enter__())
        return system

    def _run(
        self, case: TestCase, place: TrialPlace, system: RealTimeSystem | VirtualTimeSystem, started: float
    ) -> Outcome:
        context = place.context
        file, registry = context.file, context.registry
        live = system if isinstance(system, VirtualTimeSystem) else None
        inside, outside, injections = _cast(case, file)
        home = file.segment_of(file.components[inside[0]])
        if injections and outside:
            file.check_outside_apart()
        injector, seen = Injector(injections, seed=case.seed), list[Message]()
        tap = _Tap(injector)
        begin, messages = time.time_ns(), case.messages
        if messages:
            messages, _ = inject_log(messages, injections, registry=registry, seed=case.seed)
        with ExitStack() as stack:
            stack.enter_context(held(file, outside) if system in place.kept else system)
            stage = system.stage
            if live:
                begin, tap.now = messages[0].time if messages else case.messages[0].time, live.time.now
            system.begin([] if case.messages else [injector, tap], time=begin)
            watch = system.watching(home)
            controlled = file.external.topics
            internal = {parse_selector(text).topic for text in self.observe} - set(controlled)
            internal = {topic for topic in internal if not any(registry.matches(each, topic) for each in controlled)}
            for expression in context.topics(*sorted(internal)):
                watch(expression, seen.append)
            if not case.messages:
                for expression in context.topics(*sorted(set(controlled) - set(system.intercepted))):
                    watch(expression, tap.observe)
            stage.watch_outputs(context.watched, watch)
            probe = _Probe(self, stage, system.watching) if self.unit else None
            if self.record:
                writer = stack.enter_context(
                    LogWriter(
                        place.left, registry=registry, profile=context.profile, metadata=self._metadata(case, context)
                    )
                )
                watch("**", writer.write)
            system.start()
            refused = set_parameters(stage, inside, _parameters(case))
            if probe:
                probe.begin()
            unplayed, begun = False, (stage.activity(inside), stage.others.activity())
            if case.messages:
                unplayed = not self._play(messages, stage, tap.observe, live)
            else:
                self._drive(outside, inside, stage, case.seed)
            driven = stage.view(outside, settled=True, waited=_SETTLE_TIMEOUT)
            stage.end(outside)
            if outside and (latest := max((each.delay for each in injections), default=0.0)):
                stage.bus.drain(latest + _SETTLE_TIMEOUT)
            rest = probe.feeder.rest if probe else stage.settle
            certain = functools.partial(_all_at_rest, inside, stage, begun) if live else None
            settled = rest(inside, window=_SETTLED, timeout=_SETTLE_TIMEOUT, idle=stage.idle, rests=certain)
            if unplayed and settled and all(stage.launcher.alive(stage.processes[name]) for name in inside):
                raise _restless(inside, stage)
            others = [name for name in inside if not probe or name != probe.name]
            rested = settled
            if probe and others and not settled:
                rested = stage.settle(others, window=_SETTLED, timeout=_SETTLE_TIMEOUT, idle=stage.idle)
            if settled:
                stage.linger(inside, seconds=Settle().linger, timeout=_SETTLE_TIMEOUT)
            stage.bus.drain(_SETTLE_TIMEOUT)
            view = stage.view(others, settled=rested, waited=_SETTLE_TIMEOUT)
            components = [*view.components, *driven.components]
            held_up = 0.0 if live else stage.held_up(inside, since=begun)()  # virtual time waits
            view = replace(view, components=components, stalled=[*view.stalled, *driven.stalled], held_up=held_up)
            external = tuple(sorted(tap.messages, key=lambda message: message.time))
            inner = tuple(seen)
            alone = probe.end(settled=settled) if probe else None
        judged = judge(view, context.monitors)
        violations = judged.violations
        if probe and alone:
            violations += probe.judge(alone, seconds=time.monotonic() - started)
        keep = violations and not self.record and not case.messages
        log = str(place.directory / EXTERNAL_LOG) if keep else None
        if violations and self.evidence:
            whole = view if alone is None else replace(alone, components=[*view.components, *alone.components])
            write_evidence(place.left, whole, violations, context=context)
        if log:
            write_log(Path(log), external, context=context, metadata=self._metadata(case, context))
        return Outcome(
            Verdict.FAIL if violations else Verdict.PASS,
            violations,
            seconds=time.monotonic() - started,
            detail="; ".join([*judged.broken, *(f"param:{name}: {why}" for name, why in refused.items())]),
            observed=self._observed([*external, *inner], begin, registry) if self.observe else {},
            log=log,
            statistics={
                "external_messages": len(external),
                "unseen": judged.unseen,
                "held_up": round(held_up, 2),
                **({"baseless": judged.baseless} if judged.baseless else {}),
                **({"refused": refused} if refused else {}),
                **({} if case.messages else {"delivered": tap.delivered(), "modified": sum(tap.delivered())}),
                **(probe.statistics if probe else {}),
            },
        )

    def _drive(self, outside: Sequence[str], inside: Sequence[str], stage: TrialSetup, seed: int) -> None:
        """Let the external components run to their end, or until something inside has died.

        If all their commands contain {duration}, they end by themselves; otherwise they are stopped after that time.
        """
        commands = [stage.context.file.components[name].command for name in outside]
        drivers = [stage.start(name, seed=seed, pace=self.pace) for name in outside]
        watched = [stage.processes[name] for name in inside]
        ends = all(any("{duration}" in word for word in command) for command in commands)
        limit = _PATIENCE * self.pace.duration / self.pace.speed + _GRACE if ends else self.pace.duration
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            if stage.launcher.wait(drivers, timeout=_TICK) or not all(map(stage.launcher.alive, watched)):
                return
        if ends:
            late = ", ".join(repr(driver.name) for driver in drivers if driver.status is None)
            raise EnvironmentFaultError(
                f"external component {late} has not ended within {limit:.0f} s",
                hint="its command has {duration} in it, so it is expected to end by itself",
            )

    def _play(
        self,
        messages: Sequence[Message],
        stage: TrialSetup,
        observe: Callable[[Message], None],
        live: VirtualTimeSystem | None,
    ) -> bool:
        """Play messages; return False if, in virtual time, components did not come to rest before the end."""
        file, registry = stage.context.file, stage.context.registry
        segments = {
            topic: file.segment_of(component)
            for component in file.components.values()
            if component.external
            for topic in component.outputs
        }
        elsewhere = next(iter(segments.values()), file.system.segments[0])
        processes = list(stage.processes.values())

        def publish(message: Message) -> None:
            qos = Qos(message.qos.priority, "block", message.qos.express)
            observe(message)
            stage.bus.put(segments.get(registry.topic(message.key), elsewhere), message.with_(qos=qos))

        def stop() -> bool:
            return not all(map(stage.launcher.alive, processes))

        if live:
            return live.time.play(messages, stage, observe, stop=stop)
        play(messages, publish, rate=1.0, clock=SystemClock(), stop=stop)
        return True

    def _metadata(self, case: TestCase, context: Context) -> dict[str, str]:
        return {"system": context.file.system.name, "seed": str(case.seed), "duration": f"{self.pace.duration:g}"}

    def _observed(self, messages: Iterable[Message], begin: int, registry: TypeRegistry) -> dict[str, Series]:
        """Return the observed fields over time, without payloads that cannot be decoded."""
        wanted: dict[str, list[str | None]] = {}
        for text in self.observe:
            selector = parse_selector(text)
            wanted.setdefault(selector.topic, []).append(selector.field)
        times: dict[str, list[float]] = {text: [] for text in self.observe}
        values: dict[str, list[Scalar]] = {text: [] for text in self.observe}
        for message in messages:
            topic = registry.topic(message.key)
            kind = None
            for path in wanted.get(topic, ()):
                if path is None:
                    times[topic].append((message.time - begin) / 1e9)
                    continue
                kind = kind or registry.type_of_message(message)
                try:
                    value = read_field(kind, message.payload, path) if kind else None
                except PayloadError:
                    continue
                if isinstance(value, (bool, int, float, str)):
                    times[f"{topic}:{path}"].append((message.time - begin) / 1e9)
                    values[f"{topic}:{path}"].append(value)
        return {text: Series(tuple(times[text]), tuple(values[text])) for text in self.observe}


class _Probe:
    """Judges one component of a running system as in a unit trial: by its threads, and by its probe at the end.

    Args:
        trial: The trial of the whole system.
        stage: Stage on which it runs; nothing is started on it yet.
        watching: Function that returns the observer of a segment.

    Attributes:
        name: Name of the component.
        feeder: Player of the probe; set by `begin`.
        statistics: Additional statistics for the outcome of a nominal trial.
    """

    def __init__(self, trial: SystemTrial, stage: TrialSetup, watching: Callable[[str], Watch]) -> None:
        context = stage.context
        self._trial, self._stage = trial, stage
        self._unit = context.file.unit[trial.unit]
        self.name = self._unit.component or trial.unit
        component = context.file.components[self.name]
        self._baseline = trial.baseline
        self._given: list[Message] = []
        self.feeder: Feeder
        self.statistics: dict[str, object] = {}
        watch = watching(stage.segment_of(self.name))
        stage.watch_outputs(sorted(trial.baseline.log_answers), watch)
        if trial.baseline.mined.rules:
            for expression in context.topics(*component.inputs):
                watch(expression, self._given.append)

    def begin(self) -> None:
        """Sample the component's resources and, in a nominal trial, its timers, before any external input."""
        self._stage.sample_resources([self.name])
        if self._trial.nominal:
            idle = self._stage.measure_timers([self.name])
            self._baseline = replace(self._baseline, idle=idle)
            self.statistics = {"switches": idle.switches, "ran": idle.ran}
        self.feeder = Feeder(self._stage, self.name, self._unit, self._baseline, ordered=self._baseline.ordered)

    def end(self, *, settled: bool) -> TrialView:
        """Play the probe, and return the view of the component; `settled` tells whether the system is at rest."""
        stage, feeder, signs = self._stage, self.feeder, NO_SIGNS
        if self._trial.nominal:
            seen = feeder.nominal(self._baseline.probe)
            settled = settled or feeder.works(seen)
        else:
            signs, settled = feeder.signs(settled=settled)
        view = stage.view([self.name], settled=settled, waited=self._unit.settle.timeout, signs={self.name: signs})
        view = replace(view, probed=feeder.probed, inputs=[*self._given, *view.inputs])
        if self._trial.nominal:
            self.statistics["nominal"] = replace(seen, outputs=tuple(view.outputs), probed=view.probed)
        return view

    def judge(self, view: TrialView, *, seconds: float) -> tuple[Violation, ...]:
        """Return the violations of the component.

        Args:
            view: View of the component.
            seconds: Duration of the trial.
        """
        found = judge(view, [monitor() for monitor in LIVENESS]).violations
        self.feeder.end(hangs=any(each.monitor == "hang" for each in found), seconds=seconds)
        return (*found, *self._baseline.mined.judge(view))


def _cast(case: TestCase, file: SystemFile) -> tuple[list[str], list[str], tuple[Injection, ...]]:
    """Return the components inside the system, the external ones that drive a case, and the injections into topics."""
    inside = [name for name, component in file.components.items() if not component.external]
    outside = [] if case.messages else [name for name in file.components if name not in inside]
    return inside, outside, tuple(each for each in case.injections if each.topic != PARAMETERS)


def _parameters(case: TestCase) -> dict[str, bool | int | float | str | bytes]:
    """Return the parameters that a case sets."""
    return {
        str(each.field): each.value
        for each in case.injections
        if each.topic == PARAMETERS and isinstance(each.value, bool | int | float | str | bytes)
    }


def _at_start(case: TestCase, file: SystemFile) -> dict[str, bool | int | float | str | bytes]:
    """Return the parameters of commands that a case sets, without those that running nodes take."""
    return {name: value for name, value in _parameters(case).items() if name not in file.external.in_nodes}


def _all_at_rest(names: Sequence[str], stage: TrialSetup, begun: tuple[Activity, Activity]) -> bool:
    """Return whether components certainly do nothing more; `begun` is what they and the router had done before."""
    since, own = begun
    return all(stage.is_at_rest(name, since=since, own=own, window=_SETTLED) for name in names)


def _restless(names: Sequence[str], stage: TrialSetup) -> EnvironmentFaultError:
    """Return the error for a run in virtual time that was not played to its end because a component never rests."""
    busiest = max(names, key=lambda name: stage.measure_idle([name], seconds=_LOOK).switches)
    return EnvironmentFaultError(
        f"component {busiest!r} is not at rest after {_SETTLE_TIMEOUT:g} s, so the log was not played to its end",
        where=f"{stage.context.file.path}: system.clock",
        hint="virtual time is for components that act on messages and on the clock topic alone; leave `clock` out",
    )


def write_log(path: Path, messages: Iterable[Message], *, context: Context, metadata: Mapping[str, str]) -> None:
    """Write messages to a log unchanged."""
    with LogWriter(path, registry=context.registry, profile=context.profile, metadata=metadata) as writer:
        for message in messages:
            writer.write(message)
