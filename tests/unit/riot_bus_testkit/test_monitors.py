"""The conformance class of monitors holds for the shipped ones, and finds what is wrong with others."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.plugins import MONITORS
from riot_bus_testkit.monitors import MonitorConformance, trial_view
from tests.stl_env import need_rtamt

SAMPLES = {
    "range": ({"field": "a:x", "max": 2.0}, [("a", {"x": 1.0})], [("a", {"x": 3.0})]),
    "finite": ({"field": "a:x"}, [("a", {"x": 1.0})], [("a", b'{"x": NaN}')]),
    "rate": ({"topic": "a", "gap": 0.15}, [("a", {}), ("a", {})], []),
    "never": ({"when": "a where x > 2"}, [("a", {"x": 1})], [("a", {"x": 3})]),
    "values": ({"field": "a:x", "allowed": [1, 2]}, [("a", {"x": 1})], [("a", {"x": 3})]),
    "sequence": ({"field": "a:x"}, [("a", {"x": 1}), ("a", {"x": 2})], [("a", {"x": 1}), ("a", {"x": 3})]),
    "count": (
        {"output": "a", "input": "in", "low": 1, "high": 1},
        trial_view([("a", {})] * 2, inputs=[("in", {})] * 2),
        trial_view([("a", {})], inputs=[("in", {})] * 2),
    ),
    "log": ({}, trial_view([], errors="fine"), trial_view([], errors="ERROR: bad")),
    "stl": ({"formula": "always (x < 2)", "signals": {"x": "a:x"}}, [("a", {"x": 1})], [("a", {"x": 3})]),
    "sometimes": ({"when": "a where x > 2"}, [("a", {"x": 3})], [("a", {"x": 1})]),
    "answered": (
        {"request": "ask", "answer": "say", "within": 0.15},
        [("ask", {}), ("say", {})],
        [("ask", {}), ("b", {}), ("b", {}), ("b", {})],
    ),
}
FORGETS_NOTHING = """
from riot_bus.vocabulary.trial import Violation

class Counts:
    topics = ("a",)
    def __init__(self):
        self.seen = 0
    def judge(self, view):
        self.seen += len(view.outputs)
        return [Violation("counts", "a", f"{self.seen} messages")] if self.seen > 1 else []
"""


def test_there_is_a_sample_of_each_shipped_one() -> None:
    assert SAMPLES.keys() == set(MONITORS.targets()) - {"reached"}  # no single trial violates that one


@pytest.mark.parametrize("kind", SAMPLES)
class TestShipped(MonitorConformance):
    @pytest.fixture(autouse=True)
    def _chosen(self, kind: str, request: pytest.FixtureRequest) -> None:
        table, passing, failing = SAMPLES[kind]
        if kind == "stl":
            need_rtamt()
        if kind == "rate":
            failing = [("b", {})] * 3
            if "names_the_topics" in request.node.name or "without_outputs" in request.node.name:
                failing = [("a", {})]
        type(self).table, type(self).passing, type(self).failing = {"kind": kind, **table}, passing, failing


def test_one_that_remembers_earlier_trials_is_found(tmp_path: Path) -> None:
    (tmp_path / "counts.py").write_text(FORGETS_NOTHING)
    attributes = {
        "table": {"kind": str(tmp_path / "counts.py")},
        "passing": [("a", {})],
        "failing": [("a", {}), ("a", {})],
    }
    case = type("Case", (MonitorConformance,), attributes)()
    case.test_it_tells_failing_from_passing()
    with pytest.raises(AssertionError):
        case.test_it_repeats_itself()
