from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from riot_bus.monitors.arrivals import Rate
from riot_bus.monitors.invariants import Finite, Range
from riot_bus.monitors.liveness import CrashMonitor, HangMonitor
from riot_bus.monitors.model import ComponentView, TrialView
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def view(*payloads: bytes, settled: bool = True, status: int | None = None, stalled: Sequence[str] = ()) -> TrialView:
    outputs = [Message(10**9 * number, "out", payload) for number, payload in enumerate(payloads, 1)]
    component = ComponentView("part", status, "", Path("/x"))
    end = 10**9 * (len(payloads) + 1)
    return TrialView([component], settled, 2.0, TypeRegistry(), outputs, 0, end, list(stalled))


def test_range_and_finite() -> None:
    inside, outside, odd = b'{"v": 1.0}', b'{"v": 5.0}', b'{"v": NaN}'
    assert Range("out:v", min=0, max=2).judge(view(inside)) == []
    assert Range("out:v", min=0, max=2).judge(view(inside, outside))[0].signature == "range of out:v"
    assert Range("out:v", max=2).judge(view(odd)) != []
    assert Finite("out:v").judge(view(inside, outside)) == []
    assert Finite("out:v").judge(view(inside, odd)) != []


def test_rate_counts_the_gaps_at_both_ends() -> None:
    assert Rate("out", gap=1.0).judge(view(b"{}", b"{}")) == []
    assert Rate("out", gap=0.9).judge(view(b"{}", b"{}")) != []
    assert Rate("other", gap=2.9).judge(view(b"{}", b"{}")) != []


def test_hang_and_crash() -> None:
    assert HangMonitor().judge(view()) == []
    assert HangMonitor().judge(view(settled=False))[0].signature == "hang of part"
    assert HangMonitor().judge(view(stalled=["part"])) != []
    assert HangMonitor().judge(view(settled=False, status=1)) == []
    assert CrashMonitor().judge(view(status=-11))[0].signature == "crash in part: SIGSEGV"
    assert CrashMonitor().judge(view(status=0)) == []
