"""One trial of a unit: a fresh segment, a fresh process, a log played to it, and a verdict (RIOT II-A)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.inject.apply import inject_log
from riot_bus.log.playback.player import play
from riot_bus.monitors.model import judge
from riot_bus.sut.activity import STILL, Idle
from riot_bus.sut.settling import wait_sent
from riot_bus.sut.stage import TrialSetup
from riot_bus.vocabulary.clock import SystemClock
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.message import Qos
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus.sut.context import Context
    from riot_bus.sut.launcher import Launcher
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import TestCase

__all__ = ["UnitTrial"]

_CHECK_EVERY = 64


@dataclass(frozen=True, slots=True)
class UnitTrial:
    """Runs test cases against one unit.

    Attributes:
        idle: What the unit does without input.
    """

    context: Context
    unit: str
    idle: Idle = STILL

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
        messages, touched = inject_log(case.messages, case.injections, registry=self.context.registry, seed=case.seed)
        try:
            with TrialSetup(self.context, launcher, directory, segments=[segment], stall=unit.settle.timeout) as stage:
                process = stage.start(name, seed=case.seed)
                stage.wait_subscribed(name, dict.fromkeys(message.key for message in messages))
                if self.context.watched:
                    stage.watch_outputs(self.context.watched, segment=segment)
                before = stage.activity([name])

                sent = 0

                def publish(message: Message) -> None:
                    nonlocal before, sent
                    if sent % _CHECK_EVERY == 0 or sent == len(messages) - 1:
                        before = stage.activity([name])
                    sent += 1
                    qos = Qos(message.qos.priority, "block", message.qos.express)
                    stage.bus.put(segment, message.with_(qos=qos))

                def stop() -> bool:
                    return sent % _CHECK_EVERY == 0 and not launcher.alive(process)

                play(messages, publish, rate=unit.rate, clock=SystemClock(), stop=stop)
                wait_sent(timeout=unit.settle.timeout)
                settled = stage.settle(
                    [name],
                    window=unit.settle.window,
                    timeout=unit.settle.timeout,
                    idle=self.idle,
                    since=before if messages else None,
                )
                if settled:
                    stage.linger([name], seconds=unit.settle.linger, timeout=unit.settle.timeout)
                view = stage.view([name], settled=settled, waited=unit.settle.timeout)
        except EnvironmentFaultError as error:
            return Outcome(Verdict.ERROR, seconds=time.monotonic() - started, detail=str(error))
        violations, broken = judge(view, self.context.monitors)
        return Outcome(
            Verdict.FAIL if violations else Verdict.PASS,
            violations,
            seconds=time.monotonic() - started,
            detail="; ".join(broken),
            statistics={
                "played": sent,
                "messages": len(messages),
                "modified": sum(index < sent for index, _, _ in touched),
            },
        )
