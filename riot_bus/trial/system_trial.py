"""One trial of the whole system: external topics intercepted, the inside observed (RIOT II-C, II-D)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from riot_bus.log.writer import LogWriter
from riot_bus.monitors.model import judge
from riot_bus.system.system_file import Settle
from riot_bus.trial.evidence import write_evidence
from riot_bus.trial.running_system import RealTimeSystem, VirtualTimeSystem, can_be_kept, end_kept
from riot_bus.trial.system_run import RunSettings, SystemRun, parameters_at_start, roles_in
from riot_bus.types.elements import read_field
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, PayloadError
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.vocabulary.trial import Outcome, Series, Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from riot_bus.trial.context import Context
    from riot_bus.trial.setup import TrialPlace
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message, Scalar
    from riot_bus.vocabulary.trial import TestCase

EXTERNAL_LOG = "external.mcap"


@dataclass(frozen=True, slots=True)
class SystemTrial(RunSettings):
    """Runs test cases against the whole system.

    In a case without messages, the system's own external components drive it, with injections applied to what they
    publish; a case with messages plays those instead of starting the external components.

    With a unit, one component is judged as in a unit trial: when the run is over and the external components have been
    ended, it gets its probe in place, among the other components.

    The outcome's statistics contain the number of messages that each injection changed (`delivered`), and their sum
    (`modified`), how many seconds a thread of the system waited for a processor (`held_up`), and the parameters whose
    value a running node has refused, each with the reason (`refused`). In a nominal trial with a unit, `nominal` is the
    `NominalTrial`, and `switches` and `ran` are the attributes of its `Idle`.
    """

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
        made: dict[str, Any] = {"seed": case.seed, "pace": self.pace, "parameters": parameters_at_start(case, file)}
        goes_on = not (self.unit or self.record or self.evidence) and (clock is not None or can_be_kept(file, case))
        kind = RealTimeSystem if clock is None else VirtualTimeSystem
        system = next((each for each in place.kept if isinstance(each, kind)), None)
        if system and goes_on and system.fits(**made):
            return system
        end_kept(place)
        made |= {"timeout": (timeout := Settle().timeout), "stall": 6 * timeout}  # slow ones that still read keep links
        if clock is not None:
            system = VirtualTimeSystem(place, clock, **made)
        else:
            inside, outside, injections = roles_in(case, file)
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
        run = SystemRun(self, case, place, system)
        view = run.carry_out()
        judged = judge(view, context.monitors)
        violations = judged.violations
        if run.probe and run.alone:
            violations += run.probe.judge(run.alone, seconds=time.monotonic() - started)
        if violations and self.evidence:
            alone = run.alone.components if run.alone else ()
            whole = replace(run.alone or view, components=[*view.components, *alone])
            write_evidence(place.left, whole, violations, context=context)
        log = None
        if violations and not self.record and not case.messages:
            log = place.directory / EXTERNAL_LOG
            write_log(log, run.external, context=context, metadata=self.metadata(case, context))
        return Outcome(
            Verdict.FAIL if violations else Verdict.PASS,
            violations,
            seconds=time.monotonic() - started,
            detail="; ".join([*judged.broken, *(f"param:{name}: {why}" for name, why in run.refused.items())]),
            observed=self._observed([*run.external, *run.inner], run.begin, context.registry) if self.observe else {},
            log=str(log) if log else None,
            statistics={
                "external_messages": len(run.external),
                "unseen": judged.unseen,
                "held_up": round(view.held_up, 2),
                **({"baseless": judged.baseless} if judged.baseless else {}),
                **({"refused": run.refused} if run.refused else {}),
                **({} if case.messages else {"delivered": run.tap.delivered(), "modified": sum(run.tap.delivered())}),
                **(run.probe.statistics if run.probe else {}),
            },
        )

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


def write_log(path: Path, messages: Iterable[Message], *, context: Context, metadata: Mapping[str, str]) -> None:
    """Write messages to a log unchanged."""
    with LogWriter(path, registry=context.registry, profile=context.profile, metadata=metadata) as writer:
        for message in messages:
            writer.write(message)
