"""Hangs that were waited for once are told sooner, by real processes; units that are slow get their time."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.pool.local import Pool
from riot_bus.pool.nominal import measure_baseline
from riot_bus.processes.launcher import Launcher
from riot_bus.trial import signs
from riot_bus.trial.setup import TrialPlace
from riot_bus.trial.unit_trial import UnitTrial
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from tests.systems.misbehaviour.catalogue import FAULTY, write
from tests.tiers import chosen

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

TIMEOUT_S = 6.0
BUSY = "while True: pass"


@pytest.fixture
def busy_machine() -> Iterator[None]:
    others = [subprocess.Popen([sys.executable, "-S", "-c", BUSY]) for _ in range(2 * (os.cpu_count() or 1))]
    yield
    for other in others:
        other.kill()
        other.wait()


def outcomes(
    tmp_path: Path, kind: str, values: Sequence[str], *, known: Sequence[str] = (), ordered: bool = False
) -> list[Outcome]:
    """Return outcomes of trials of a unit, in which the tenth command has these values, one after the other.

    Args:
        tmp_path: Folder.
        kind: The unit.
        values: Values of `x` as JSON.
        known: Functions, the innermost first, in which it is told to have hung before.
        ordered: Whether the order across topics is kept in any case, not only where that is cheap.
    """
    path = write(tmp_path)
    path.write_text(path.read_text().replace("timeout = 2.0", f"timeout = {TIMEOUT_S}"))
    with (
        Workspace(path, tmp_path / "out") as workspace,
        Pool(path, 1, keep=tmp_path / "trials") as pool,
        Launcher() as launcher,
    ):
        log = workspace.unit_log(kind)
        baseline = measure_baseline(workspace.context, kind, pool, log)
        if known:
            workspace.context.hangs[kind].add(frozenset({tuple(known)}), waited=TIMEOUT_S)
        trial = UnitTrial(kind, baseline)
        (at,) = [number for number, message in enumerate(log) if b'"x": 4.5,' in message.payload]

        def case(value: str) -> tuple[Message, ...]:
            bad = log[at].with_(payload=log[at].payload.replace(b"4.5", value.encode()))
            return (*log[:at], bad, *log[at + 1 :])

        def run(number: int, value: str) -> Outcome:
            folder = tmp_path / str(number)
            folder.mkdir()
            place = TrialPlace(workspace.context, launcher, folder, {})
            return trial.run(TestCase(case(value), ordered=ordered or baseline.ordered), place)

        return [run(number, value) for number, value in enumerate(values)]


@pytest.mark.parametrize("kind", chosen(("busy", "livelock", "deadlock"), gate=("busy",)))
def test_a_hang_that_was_seen_is_told_sooner_with_the_same_signature(tmp_path: Path, kind: str) -> None:
    first, *others = outcomes(tmp_path, kind, ["1e9", "1e9", "null"])
    for outcome in (first, *others):
        assert [each.signature for each in outcome.violations] == [str(FAULTY[kind]).format(kind)]
    if kind == "busy":  # a deadlock comes to rest, and a livelock may seem to
        assert "still busy 6 s after its last input" in first.violations[0].detail
        assert "another trial" not in first.violations[0].detail
        assert all("in another trial" in outcome.violations[0].detail for outcome in others)
        assert all(outcome.seconds < first.seconds for outcome in others)


def test_what_has_ended_is_not_waited_for_to_take_more_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signs, "_TAKEN_S", 1e9)
    (outcome,) = outcomes(tmp_path, "exit_zero", ["1e9"], ordered=True)
    assert [each.signature for each in outcome.violations] == [str(FAULTY["exit_zero"]).format("exit_zero")]


@pytest.mark.parametrize("kind", chosen(("slow", "timers", "restarts_thread"), gate=()))
@pytest.mark.usefixtures("busy_machine")
def test_a_unit_that_is_slow_where_it_is_told_to_have_hung_is_given_its_time(tmp_path: Path, kind: str) -> None:
    for outcome in outcomes(tmp_path, kind, ["1.0", "1e9", "null"], known=["handle", "main", "<module>"]):
        assert (outcome.verdict, outcome.violations) == (Verdict.PASS, ())
