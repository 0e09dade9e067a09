"""The envelope of a topic: bounds, order, norms, and messages that cannot be read."""

from __future__ import annotations

import pytest

from riot_bus.monitors.envelope import Envelope
from riot_bus.monitors.forging import why_cannot_fire
from riot_bus.monitors.model import judge
from riot_bus.testing.monitors import Output, trial_view

MONITOR = Envelope(
    "a", {"x": (0.0, 2.0), "r[*]": (None, 5.0), "len(r)": (1.0, 3.0)}, ("n",), {"q": (1.0, 0.01), "other": (2.0, 0.1)}
)
GOOD = {"x": 1.0, "r": [1, 5], "n": 0, "q": {"x": 0.6, "y": 0.0, "z": 0.8, "w": 0.0}}


def outputs(**changes: object) -> list[Output]:
    return [*(("a", {**GOOD, "n": number}) for number in range(6)), ("a", {**GOOD, "n": 6, **changes})]


def test_what_is_inside_passes() -> None:
    assert judge(trial_view(outputs()), [MONITOR]).violations == ()
    assert judge(trial_view([("b", {})]), [MONITOR]).unseen == ("Envelope a: no message of 'a' came; known: b",)
    assert why_cannot_fire(MONITOR, trial_view(outputs())) is None
    assert why_cannot_fire(Envelope("a", increasing=("n",)), trial_view(outputs())) is None


@pytest.mark.parametrize(
    ("changes", "signature"),
    [
        ({"x": 2.5}, "envelope: a:x out of bounds"),
        ({"x": float("nan")}, "envelope: a:x not finite"),
        ({"r": [1, -9, 6]}, "envelope: a:r[*] out of bounds"),
        ({"r": []}, "envelope: a:len(r) out of bounds"),
        ({"n": 0}, "envelope: a:n decreases"),
        ({"q": {"x": 1.0, "y": 0.0, "z": 0.8, "w": 0.0}}, "envelope: a:q has another norm"),
    ],
)
def test_what_is_outside_does_not(changes: dict[str, object], signature: str) -> None:
    (found,) = MONITOR.judge(trial_view(outputs(**changes)))
    assert found.signature == signature


def test_messages_may_overtake_each_other_and_garbage_may_not_come() -> None:
    assert MONITOR.judge(trial_view([*outputs(), ("a", {**GOOD, "n": 4})])) == []
    assert MONITOR.judge(trial_view([*outputs(), ("a", b"\xff")]))[0].signature == "envelope: a cannot be read"
