"""One trial of a unit: an empty segment, a fresh process, a log played to it, and a verdict (RIOT II-A)."""

from __future__ import annotations

import functools
import hashlib
import time
from bisect import bisect_left
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import LogReader
from riot_bus.monitors.forging import mute_monitors
from riot_bus.monitors.model import judge
from riot_bus.router.services.recorded import RecordedCall, RecordedService, calls_in
from riot_bus.trial.baseline import UNKNOWN, Baseline, growth_of
from riot_bus.trial.evidence import write_evidence
from riot_bus.trial.observation import MEASURE_S
from riot_bus.trial.setup import held
from riot_bus.trial.signs import Feeder
from riot_bus.types.serve import PARTS
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, did_you_mean
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from riot_bus.trial.context import Context
    from riot_bus.trial.network import TrialNetwork
    from riot_bus.trial.setup import TrialPlace, TrialSetup
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import TestCase

_GROWN = 1 / 32
"""Least share of allowed growth that a trial reports: 1 MiB, since allocators differ by some hundred KiB, or 1 file."""
_MOST_NAMES = 64
"""Largest number of keys whose outputs are compared with nominal ones, and of topics and fields in a summary, so that a
line of the store stays below some KiB."""


@dataclass(frozen=True, slots=True)
class IdleTrial:
    """Watches a unit without input; the outcome's statistics have the attributes of an `Idle`."""

    unit: str

    def run(self, case: TestCase, place: TrialPlace) -> Outcome:
        """Start the unit and watch it."""
        try:
            with unit_setup(self.unit, place) as setup:
                name, observation = setup.context.file.component_of(self.unit), setup.observation
                serve_calls(setup.network, setup.context, self.unit)
                setup.start(name, seed=case.seed)
                setup.readiness.wait_ready([name])
                observation.settle([name], window=MEASURE_S, timeout=1.0)
                idle = observation.measure_timers([name])
        except EnvironmentFaultError as error:
            return Outcome(Verdict.ERROR, detail=str(error))
        return Outcome(Verdict.PASS, statistics={"switches": idle.switches, "ran": idle.ran})


@dataclass(frozen=True, slots=True)
class UnitTrial:
    """Runs test cases against one unit.

    Attributes:
        nominal: Whether cases are the nominal log; then `nominal` in the outcome's statistics is the `NominalTrial`.
        evidence: Whether a failing trial, or one behind a debugger, leaves evidence in `TrialPlace.left`; then nothing
            is forked.
    """

    unit: str
    baseline: Baseline = UNKNOWN
    nominal: bool = False
    evidence: bool = False
    before: tuple[str, ...] = ()

    def run(self, case: TestCase, place: TrialPlace) -> Outcome:
        """Play the case to a freshly started unit and judge what it does.

        A fault of the environment has its own verdict (`Verdict.ERROR`) and is never a failure of the unit.
        """
        more: dict[str, Any] = {"imports": None} if self.evidence else {}
        try:
            with unit_setup(self.unit, place, **more) as setup:
                self._start(setup, case)
                return self._play(setup, case, place.left)
        except EnvironmentFaultError as error:
            return Outcome(Verdict.ERROR, detail=str(error))

    def _start(self, setup: TrialSetup, case: TestCase) -> None:
        """Start the unit, and wait until it has subscribed to the keys of the messages that it will get."""
        name, network = setup.context.file.component_of(self.unit), setup.network
        serve_calls(network, setup.context, self.unit)
        setup.start(name, seed=case.seed, before=self.before)
        keys = dict.fromkeys(each.key for each in (*case.messages, *self.baseline.probe))
        setup.readiness.wait_subscribed(name, keys)
        inputs = setup.context.file.components[name].inputs
        network.watch_all_outputs(segment=network.segment_of(name), inputs=inputs)

    def _play(self, setup: TrialSetup, case: TestCase, left: Path) -> Outcome:
        """Play the case to the unit, and judge what it does; `left` is the folder for evidence."""
        started = time.monotonic()
        context, unit = setup.context, setup.context.file.unit[self.unit]
        name, reached, ahead = context.file.component_of(self.unit), list[list[int]](), list[int]()
        messages, touched = inject_log(
            case.messages, case.injections, registry=context.registry, seed=case.seed, reached=reached, ahead=ahead
        )
        ordered = unit.order == "log" or (unit.order == "auto" and case.ordered)
        feeder = Feeder(setup, name, unit, self.baseline, ordered=ordered)
        settled = feeder.feed_case(messages)
        sent, answers = feeder.sent, tuple(setup.network.outputs)
        turns = len(case.messages) if sent == len(messages) else bisect_left(ahead, sent)  # of the log's own messages
        if self.before:
            setup.processes.wait([name], timeout=60.0)  # a debugger reads symbols
        seen = feeder.nominal(self.baseline.probe) if self.nominal else None
        settled = settled or (seen is not None and feeder.works(seen))
        signs, settled = feeder.signs(settled=settled, unprobed=case.unprobed)
        samples = setup.observation.sample_resources(name)
        view = setup.view([name], settled=settled, waited=unit.settle.timeout, signs={name: signs})
        view = replace(view, probed=feeder.probed, held_up=setup.observation.held_up([name], since=feeder.begun)())
        monitors = context.monitors_of(name)
        judged = judge(view, monitors)
        if seen is not None:
            mute = mute_monitors(view, monitors)
            seen = replace(seen, mute=mute, outputs=tuple(view.outputs), probed=view.probed)
        violations = (*judged.violations, *self.baseline.mined.judge(view))
        grown = self.baseline.excess(growth_of(samples), input_bytes=sum(len(each.payload) for each in view.inputs))
        feeder.end(hangs=any(each.monitor == "hang" for each in violations), seconds=time.monotonic() - started)
        if self.evidence and (violations or self.before):
            write_evidence(left, view, violations, context=context)
        return Outcome(
            Verdict.FAIL if violations else Verdict.PASS,
            violations,
            seconds=time.monotonic() - setup.begun,
            detail="; ".join(judged.broken),
            statistics={
                "played": sent,
                "messages": len(messages),
                "modified": sum(index < turns for index, _, _ in touched),
                "delivered": [sum(index < turns for index in each) for each in reached],
                "shown": _shown(answers),
                "outputs": len(answers),
                "started": setup.processes.started[name].started,
                "unseen": [*judged.unseen, *self.baseline.mute],
                **({"baseless": judged.baseless} if judged.baseless else {}),
                **({"unordered": True} if feeder.gave_up else {}),
                **({"grown": grown} if grown >= _GROWN and not violations else {}),
                **({"nominal": seen} if seen is not None else {}),
            },
        )


@contextmanager
def unit_setup(unit: str, place: TrialPlace, **options: Any) -> Iterator[TrialSetup]:
    """Reserve the resources that a unit needs, and open a setup for it alone."""
    context = place.context.alone(unit)
    file, name = context.file, context.file.component_of(unit)
    segments, stall = [file.segment_of(file.components[name])], file.unit[unit].settle.timeout
    setup = place.setup(context=context, segments=segments, stall=stall, attach=[name], **options)
    with held(file, [name]), setup:
        yield setup


def serve_calls(network: TrialNetwork, context: Context, unit: str) -> None:
    """Answer the calls that a unit makes; raises as `calls_of_unit`."""
    segment = network.segment_of(context.file.component_of(unit))
    for number, (key, calls) in enumerate(calls_of_unit(context, unit).items(), start=1):
        network.serve(segment, key, RecordedService(calls), number=number)


def calls_of_unit(context: Context, unit: str) -> Mapping[str, Sequence[RecordedCall]]:
    """Return the recorded calls of the services that a unit calls, by key.

    Raises:
        ConfigError: The log has no answered call of one of the services, or riot.toml names no log.
    """
    file = context.file
    described = file.unit[unit]
    name = file.component_of(unit)
    services = file.components[name].calls
    if not services:
        return {}
    where, log = f"{file.path}: [components.{name}] calls", described.log or file.system.nominal
    hint = "record one with `riot router --record --intercept-services ...`"
    if log is None:
        raise ConfigError("no log is named that could have the calls of a service", where=where, hint=hint)
    path = file.root / log
    expressions = tuple(context.registry.key_expression(f"{service}/{part}") for service in services for part in PARTS)
    found = _calls(path, path.stat().st_mtime_ns, expressions)
    names = {context.registry.topic(key): key for key in found} | {key: key for key in found}
    for service in services:
        if service not in names and not any(context.registry.matches(service, key) for key in found):
            near = did_you_mean(service, names)
            raise ConfigError(f"{path} has no call of {service!r} with a reply", where=where, hint=near or hint)
    return found


@functools.lru_cache(maxsize=4)
def _calls(path: Path, changed: int, expressions: tuple[str, ...]) -> Mapping[str, Sequence[RecordedCall]]:
    """Return the calls of a log, which are the same for all trials as long as it has not `changed`."""
    with LogReader(path) as reader:
        return calls_in(reader.messages(topics=expressions))


def _shown(outputs: Sequence[Message]) -> dict[str, tuple[int, str]] | None:
    """Return the number of outputs and an order-independent hash of their payloads, by key; None for too many keys."""
    payloads: dict[str, list[bytes]] = {}
    for message in outputs:
        payloads.setdefault(message.key, []).append(hashlib.sha256(message.payload).digest())
    if len(payloads) > _MOST_NAMES:
        return None
    return {key: (len(each), hashlib.sha256(b"".join(sorted(each))).hexdigest()[:16]) for key, each in payloads.items()}
