"""What is concluded from the activity of components, with activity that is written down beforehand."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.processes.activity import Idle
from riot_bus.trial.observation import Observation


class _Seen(Observation):
    """An observation whose measurements are given."""

    def __init__(self, *measured: Idle, rests: bool = True) -> None:
        super().__init__(SimpleNamespace(), SimpleNamespace())  # type: ignore[arg-type]
        self.left, self.settled, self._rests = list(measured), 0, rests

    def measure_idle(self, names: Sequence[str], *, seconds: float) -> Idle:
        return self.left.pop(0)

    def settle(self, names: Sequence[str], **options: Any) -> bool:
        self.settled += 1
        return self._rests

    def include_started(self, names: object) -> bool:
        return True

    def wants_processor(self, names: object) -> bool:
        return False


STARTING, TIMERS = Idle(200.0, 0.9), Idle(40.0, 0.1)


def come_to_rest(seen: _Seen, known: list[Idle]) -> Idle:
    seen.come_to_rest(["part"], known, deadline=time.monotonic() + 10)
    return seen.idle


def test_a_component_without_timers_rests_at_once() -> None:
    known: list[Idle] = []
    assert come_to_rest(_Seen(Idle(2.0, 0.001)), known) == Idle(2.0, 0.001)
    assert len(known) == 1


def test_timers_are_what_comes_twice_in_a_row() -> None:
    seen = _Seen(STARTING, TIMERS, Idle(44.0, 0.12), STARTING)
    assert come_to_rest(seen, []) == Idle(44.0, 0.12)
    assert seen.left == [STARTING]


def test_what_a_start_leaves_to_do_is_no_timer() -> None:
    """It took little of the processor, and was taken for a timer: 79 switches a second of a unit that has none."""
    assert come_to_rest(_Seen(Idle(79.0, 0.02), Idle(10.0, 0.001), Idle(13.0, 0.001)), []) == Idle(13.0, 0.001)


def test_what_was_measured_three_times_is_not_measured_again() -> None:
    known = [Idle(1.0), Idle(9.0), Idle(2.0)]
    seen = _Seen()
    assert come_to_rest(seen, known) == Idle(2.0)
    assert (seen.settled, len(known)) == (1, 3)


def test_a_deadline_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    known: list[Idle] = []
    _Seen(STARTING).come_to_rest(["part"], known, deadline=time.monotonic() - 1)
    assert known == []


def test_timers_are_looked_for_until_there_is_nothing_for_a_while() -> None:
    assert _Seen(TIMERS, Idle()).measure_timers(["part"]) == Idle()
    least = Idle(38.0, 0.1)
    assert _Seen(TIMERS, least, TIMERS).measure_timers(["part"]) == least


def test_resources_are_noted_over_time_and_discarded_by_a_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    processes = SimpleNamespace(roots=lambda names: (), bridges={})
    seen = Observation(processes, SimpleNamespace(inputs=[1, 2]))  # type: ignore[arg-type]
    assert [each.messages for each in seen.sample_resources("part")] == [2]
    assert len(seen.sample_resources("part")) == len(seen.samples("part")) == 2
    seen.restart()
    assert seen.samples("part") == ()
