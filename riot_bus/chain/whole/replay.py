"""Replays of the external messages of a failing run of the whole system, and the few that the failure needs."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from riot_bus.chain.unit.questions import FreshCases
from riot_bus.chain.whole.driven_system import DrivenSystem
from riot_bus.generalize.minimize import minimize
from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import read_log
from riot_bus.statistics.noise import Noise
from riot_bus.trial.system_trial import write_log
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.trial import TestCase

_REPLAYS = 10  # all of them failing shows a rate above 0.74 with 95 %


class Replay(NamedTuple):
    """The results of replays.

    Attributes:
        messages: Number of external messages; 0 if they were not kept.
        needed: Number of messages that are enough; 0 if unknown.
        proven: Whether it was shown that none of these can be left out.
        others: Signatures of other failures of these replays, each once for each replay.
    """

    messages: int = 0
    total: int = 0
    failed: int = 0
    needed: int = 0
    proven: bool = False
    others: tuple[str, ...] = ()

    @property
    def reliable(self) -> bool:
        """Whether so many replays failed that one is expected to; so without any replay."""
        return self.failed >= 0.9 * self.total


def replay(system: DrivenSystem, case: TestCase | None, log: str | None) -> Replay:
    """Replay only the external messages of a failing run in fresh runs, all and then fewer; write the logs.

    Args:
        log: Path of the log of its external messages; None if the case itself plays them.
    """
    target, context = system.folder / "activation.mcap", system.step.workspace.context
    metadata = {"system": context.file.system.name, "seed": str(case.seed if case else 0)}
    if case is not None and case.messages:
        injections = [each for each in case.injections if each.topic != PARAMETERS]
        external, _ = inject_log(case.messages, injections, registry=context.registry, seed=case.seed)
        write_log(target, external, context=context, metadata=metadata)
    elif log is None:
        return Replay()
    elif Path(log).is_file():
        shutil.copyfile(log, target)
    external = read_log(target)
    if not external:
        return Replay()
    parameters = tuple(each for each in (case.injections if case else ()) if each.topic == PARAMETERS)
    cases = [
        TestCase(external, parameters, seed=system.step.workspace.seed + number, paced=True)
        for number in range(_REPLAYS)
    ]
    outcomes = system.runner.run(cases)
    failed = sum(outcome.failed_as(system.finding.signature) for outcome in outcomes)
    played = Replay(len(external), _REPLAYS, failed, others=tuple(system.otherwise(outcomes)))
    if not played.reliable:
        return played
    runner = FreshCases(system.runner, after=1)  # the first trial of the whole is one of the replays

    def ask(parts: Sequence[tuple[int, ...]]) -> list[bool]:
        asked = [
            TestCase(tuple(external[place] for place in part), parameters, seed=system.step.workspace.seed, paced=True)
            for part in parts
            if part  # without any, external components would drive the system
        ]
        answers = iter(runner.failures(asked, system.finding.signature))
        return [bool(part) and next(answers) for part in parts]

    try:
        minimal = minimize(
            len(external),
            ask,
            groups=[context.registry.topic(message.key) for message in external],
            noise=Noise.after(failed, _REPLAYS, nominal_total=system.controls()[1]),
            budget=60,  # about log2 of the number of messages for each that is needed
            parallelism=runner.parallelism,
            progress=system.step.progress,
        )
    except InconclusiveError:  # chance has led the search to messages that do not fail
        return played
    kept = [external[place] for place in minimal.kept]
    write_log(system.folder / "activation-minimal.mcap", kept, context=context, metadata=metadata)
    return played._replace(needed=len(kept), proven=minimal.one_minimal)
