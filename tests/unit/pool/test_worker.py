"""What a worker is told of hangs, and what it tells."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.pool import worker as module
from riot_bus.pool.wire import TrialAnswer, TrialBatch, read_answer
from riot_bus.pool.worker import TrialWorker
from riot_bus.processes.launcher import Launcher
from riot_bus.trial.hangs import KnownHangs
from riot_bus.trial.setup import TrialPlace
from riot_bus.trial.unit_trial import UnitTrial
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

SPIN, WAIT = (("spin", "main"),), (("wait", "main"),)


class NoLauncher(Launcher):
    """Starts nothing."""

    def __init__(self) -> None:
        pass

    def cpu(self) -> float:
        return 0.0


def test_it_goes_on_with_what_others_know_and_tells_what_is_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known: list[KnownHangs] = []
    new: list[frozenset[tuple[str, ...]]] = []

    def run(self: UnitTrial, case: TestCase, place: TrialPlace) -> Outcome:
        hangs = place.context.hangs[self.unit]
        known.append(hangs.tell())
        for each in new:
            hangs.add(each, waited=1.0)
        return Outcome(Verdict.PASS)

    monkeypatch.setattr(UnitTrial, "run", run)
    monkeypatch.setattr(module, "prepare_runtime", lambda _: None)
    path = tmp_path / "riot.toml"
    path.write_text('[components.u]\ncommand = ["true"]\ninputs = ["a"]\n')
    worker, batch = TrialWorker(path, NoLauncher()), TrialBatch(UnitTrial("u"), ())

    def ask(told: KnownHangs) -> TrialAnswer:
        request = batch.request(TestCase(), directory=tmp_path, whole=True, imports={}, hangs={"u": told})
        return read_answer(worker.answer(request))

    told = KnownHangs((SPIN,), 0.5)
    assert ask(told).hangs == {}
    new.append(frozenset(WAIT))
    assert ask(told).hangs == {"u": KnownHangs((SPIN, WAIT), 0.5)}
    new.clear()
    assert ask(KnownHangs((WAIT,), 0.75)).hangs == {}
    assert known == [told, told, KnownHangs((WAIT,), 0.75)]
