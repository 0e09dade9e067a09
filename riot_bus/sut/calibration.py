"""What a unit does when nobody asks anything of it: needed to tell working from idling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.sut.activity import Idle
from riot_bus.sut.stage import TrialSetup
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus.sut.context import Context
    from riot_bus.sut.launcher import Launcher
    from riot_bus.sut.local import Pool

__all__ = ["measure_idle"]

_WARM_UP = 0.15
_WATCH = 0.5


@dataclass(frozen=True, slots=True)
class _IdleTrial:
    context: Context
    unit: str

    def run(self, case: TestCase, launcher: Launcher, directory: Path) -> Outcome:
        file = self.context.file
        name = file.unit[self.unit].component or self.unit
        try:
            with TrialSetup(
                self.context, launcher, directory, segments=[file.segment_of(file.components[name])]
            ) as stage:
                stage.start(name, seed=case.seed)
                stage.wait_ready([name])
                stage.settle([name], window=_WARM_UP, timeout=1.0)
                idle = stage.measure_idle([name], seconds=_WATCH).or_more(stage.idle)
        except EnvironmentFaultError as error:
            return Outcome(Verdict.ERROR, detail=str(error))
        return Outcome(Verdict.PASS, statistics={"switches": idle.switches, "ran": idle.ran})


def measure_idle(context: Context, unit: str, pool: Pool) -> Idle:
    """Return what a unit does that gets no input.

    Raises:
        EnvironmentFaultError: The unit does not start.
    """
    outcome = pool.execute(_IdleTrial(context, unit), TestCase())
    if outcome.verdict is Verdict.ERROR:
        raise EnvironmentFaultError(outcome.detail)
    return Idle(float(outcome.statistics["switches"]), float(outcome.statistics["ran"]))
