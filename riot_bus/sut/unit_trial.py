"""One trial of a unit: a fresh segment, a fresh process, a log played to it, and a verdict (RIOT II-A)."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from riot_bus.inject.apply import inject_log
from riot_bus.monitors.forging import mute_monitors
from riot_bus.monitors.model import judge
from riot_bus.sut.baseline import UNKNOWN, Baseline
from riot_bus.sut.evidence import write_evidence
from riot_bus.sut.scarce import held
from riot_bus.sut.signs import Feeder
from riot_bus.sut.stage import TrialSetup
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from collections.abc import MutableMapping, Sequence
    from pathlib import Path

    from riot_bus.sut.baseline import NominalTrial
    from riot_bus.sut.context import Context
    from riot_bus.sut.launcher import Launcher
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import TestCase

__all__ = ["UnitTrial"]

_DEBUGGER_S = 60.0
"""Most of it goes into reading symbols."""
_MOST_KEYS = 64
"""Keys whose outputs are compared with nominal ones: a line of the store stays below some KiB."""


@dataclass(frozen=True, slots=True)
class UnitTrial:
    """Runs test cases against one unit.

    Attributes:
        baseline: What the unit does in nominal trials; without one, a trial is only judged by what needs none.
        nominal: If given, cases are the nominal log, and what the unit shows in them is added here.
        evidence: Folder for what a failing trial leaves, or one behind a debugger; None to keep nothing.
        before: Words before the unit's command, such as those of a debugger.
        imports: Modules that Python components import, by name; trials fill it.
    """

    context: Context
    unit: str
    baseline: Baseline = UNKNOWN
    nominal: list[NominalTrial] | None = None
    evidence: Path | None = None
    before: tuple[str, ...] = ()
    imports: MutableMapping[str, Sequence[str]] | None = None

    def run(self, case: TestCase, launcher: Launcher, directory: Path) -> Outcome:
        """Play the case to a freshly started unit and judge what it does.

        An environment that fails is an outcome of its own (`Verdict.ERROR`), never a failure of the unit.
        """
        started = time.monotonic()
        file = self.context.file
        unit = file.unit[self.unit]
        name = unit.component or self.unit
        component = file.components[name]
        segment = file.segment_of(component)
        registry, reached = self.context.registry, list[list[int]]()
        messages, touched = inject_log(
            case.messages, case.injections, registry=registry, seed=case.seed, reached=reached
        )
        try:
            with (
                held(file, [name]),
                TrialSetup(
                    self.context,
                    launcher,
                    directory,
                    segments=[segment],
                    stall=unit.settle.timeout,
                    imports=self.imports,
                ) as stage,
            ):
                process = stage.start(name, seed=case.seed, before=self.before)
                stage.wait_subscribed(name, dict.fromkeys(each.key for each in (*messages, *self.baseline.probe)))
                stage.watch_all_outputs(segment=segment, inputs=component.inputs)
                ordered = unit.order == "log" or (unit.order == "auto" and case.ordered)
                feeder = Feeder(stage, name, unit, self.baseline, ordered=ordered)
                settled = feeder.feed(messages)
                sent, answered = feeder.sent, len(stage.outputs)
                if self.before:
                    stage.launcher.wait([process], timeout=_DEBUGGER_S)
                seen = None if self.nominal is None else feeder.nominal(self.baseline.probe)
                settled = settled or (seen is not None and feeder.works(seen))
                signs, settled = feeder.signs(settled=settled)
                stage.sample_resources([name])
                view = stage.view([name], settled=settled, waited=unit.settle.timeout, signs={name: signs})
                view = replace(view, probed=feeder.probed)
        except EnvironmentFaultError as error:
            return Outcome(Verdict.ERROR, seconds=time.monotonic() - started, detail=str(error))
        monitors = self.context.monitors_of(name)
        judged = judge(view, monitors)
        if self.nominal is not None and seen is not None:  # trials of several threads add to one list
            self.nominal.append(replace(seen, mute=mute_monitors(view, monitors), view=view))
        violations = (*judged.violations, *self.baseline.mined.judge(view))
        feeder.end(hangs=any(each.monitor == "hang" for each in violations), seconds=time.monotonic() - started)
        if self.evidence and (violations or self.before):
            write_evidence(self.evidence, view, violations, context=self.context)
        return Outcome(
            Verdict.FAIL if violations else Verdict.PASS,
            violations,
            seconds=time.monotonic() - started,
            detail="; ".join(judged.broken),
            statistics={
                "played": sent,
                "messages": len(messages),
                "modified": sum(index < sent for index, _, _ in touched),
                "delivered": [sum(index < sent for index in each) for each in reached],
                "shown": _shown(stage.outputs[:answered]),
                "outputs": answered,
                "started": process.started,
                "unseen": [*judged.unseen, *self.baseline.mute],
            },
        )


def _shown(outputs: Sequence[Message]) -> dict[str, tuple[int, str]] | None:
    """Return how many outputs came and a hash of their payloads in any order, by key; None if there are many keys."""
    payloads: dict[str, list[bytes]] = {}
    for message in outputs:
        payloads.setdefault(message.key, []).append(hashlib.sha256(message.payload).digest())
    if len(payloads) > _MOST_KEYS:
        return None
    return {key: (len(each), hashlib.sha256(b"".join(sorted(each))).hexdigest()[:16]) for key, each in payloads.items()}
