from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_fleet.agent.request import Policy
from riot_bus_fleet.agent.watch import ControllerWatch


@pytest.mark.parametrize("policy", ["stop", "pause"])
def test_a_controller_counts_as_lost_after_the_grace_time(policy: Policy) -> None:
    watch = ControllerWatch(policy, 10.0, 100.0)
    assert watch.look(109.9, present=False) is None
    assert watch.away(109.9) == pytest.approx(9.9)
    assert watch.look(110.0, present=False) == policy
    assert watch.look(111.0, present=False) is None


def test_a_short_break_is_no_loss() -> None:
    watch = ControllerWatch("stop", 10.0, 0.0)
    for start in range(0, 100, 10):
        assert watch.look(start + 9.0, present=False) is None
        assert watch.look(start + 10.0, present=True) is None
    assert watch.away(100.0) == 0.0


def test_after_a_pause_it_is_resumed_when_the_controller_is_back() -> None:
    watch = ControllerWatch("pause", 1.0, 0.0)
    assert watch.look(2.0, present=False) == "pause"
    assert watch.look(3.0, present=True) == "resume"
    assert watch.look(3.5, present=True) is None
    assert watch.look(4.5, present=False) == "pause"


def test_without_grace_the_first_look_decides() -> None:
    assert ControllerWatch("stop", 0.0, 5.0).look(5.0, present=False) == "stop"


@given(
    st.sampled_from(["continue", "pause", "stop"]),
    st.floats(0, 10),
    st.lists(st.tuples(st.floats(0, 10), st.booleans())),
)
def test_nothing_is_done_twice_nor_without_the_controller_being_away(
    policy: Policy, grace: float, looks: list[tuple[float, bool]]
) -> None:
    watch, now, seen, acted = ControllerWatch(policy, grace, 0.0), 0.0, 0.0, False
    for pause, present in looks:
        now += pause
        action = watch.look(now, present=present)
        if present:
            assert action == ("resume" if acted and policy == "pause" else None)
            seen, acted = now, False
        elif action is not None:
            assert (action, acted) == (policy, False)
            assert now - seen >= grace
            acted = True
        if policy == "continue":
            assert action is None
