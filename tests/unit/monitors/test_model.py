"""What all monitors say of a trial: violations, those that failed themselves, those that had nothing to judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.monitors.arrivals import Never, Rate, Ratio, Sometimes
from riot_bus.monitors.exchanges import Answered
from riot_bus.monitors.invariants import Finite, Gapless, Range, Values
from riot_bus.monitors.model import ComponentView, Invariant, Judgement, TrialView, judge
from riot_bus.vocabulary.trial import Violation
from riot_bus_testkit.monitors import trial_view

VIEW = trial_view([("speed", {"x": 1, "name": "a"}), ("odom", {"x": 2.0})])


class Broken:
    def judge(self, view: TrialView) -> Sequence[Violation]:
        raise RuntimeError("oops")


class Plain:
    topics = ("sped",)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        return []


@pytest.mark.parametrize(
    ("monitor", "line"),
    [
        (Range("sped:x", max=2), "Range: no message of 'sped' came; did you mean 'speed'?"),
        (Finite("speed:y"), "Finite: of 1 messages of 'speed': no field 'y'; known: name, x"),
        (Range("speed:name", max=2), "Range: of 1 messages of 'speed': 'name' is not a number"),
        (Values("speed:x where x > 5", allowed=(1,)), "Values: of 1 messages of 'speed': none meets 'x > 5'"),
        (Gapless("speed:x"), "Gapless: only one message of speed:x came"),
        (Rate("odom", gap=9.0), "Rate: the trial took 0.300 s, which is no longer than the gap allowed"),
        (Rate("other", gap=9.0), "Rate: no message of 'other' came; known: odom, speed"),
        (Never("odom where y > 1"), "Never: of 1 messages of 'odom': no field 'y'; known: x"),
        (Answered("ask", answer="odom", within=0.1), "Answered: no message of 'ask' came; known: odom, speed"),
        (Answered("odom", answer="say", within=5.0), "Answered: each of 1 requests could still be answered at the end"),
        (Ratio("speed", "ask", 1, 2), "Ratio: no input 'ask' came"),
        (Plain(), "Plain: no message of 'sped' came; did you mean 'speed'?"),
    ],
)
def test_one_that_had_nothing_to_judge_says_why(monitor: Invariant, line: str) -> None:
    found = judge(VIEW, [monitor])
    kind, _, reason = line.partition(": ")
    ((name, _, told),) = (each.partition(": ") for each in found.unseen)
    assert (name.split()[0], told) == (kind, reason)
    assert found == Judgement(unseen=found.unseen)


@pytest.mark.parametrize(
    "monitor",
    [
        Range("speed:x", max=2),
        Finite("*:x"),
        Never("alarm"),
        Never("odom where x > 5"),
        Ratio("speed", "odom", 1, 2),
        Rate("odom", gap=0.25),
    ],
)
def test_one_that_had_something_is_silent(monitor: Invariant) -> None:
    assert judge(VIEW, [monitor]) == Judgement()


def test_one_that_raises_is_isolated_and_never_called_unseen() -> None:
    assert judge(VIEW, [Broken(), Values("odom:x", allowed=(1,))]).broken == (
        "Broken: RuntimeError: oops",
        "Values odom:x: PayloadError: odom:x is not an integer",
    )


def test_the_start_is_the_first_input() -> None:
    assert VIEW.start == 0
    assert trial_view([], inputs=[("a", {}), ("a", {})], step=0.5).start == 5 * 10**8


def test_monitors_of_one_name_are_told_apart() -> None:
    view = trial_view([("a", {"x": 1.0})])
    judged = judge(view, [Range("b:y", min=0.0), Range("b:y", max=9.0)])
    assert [line.partition(": ")[0] for line in judged.unseen] == ["Range b:y", "Range b:y (2)"]


@pytest.mark.parametrize("monitor", [Sometimes("b"), Sometimes("b where y > 1"), Ratio("b", "a", 1.0, 1.0)])
def test_what_is_missed_of_topics_that_never_came_is_told_apart(monitor: Invariant) -> None:
    inputs = [("a", {"x": 1.0})]
    (violation,) = judge(trial_view([("c", {"y": 1.0})], inputs=inputs), [monitor]).violations
    judged = judge(trial_view([("c", {"y": 1.0})], inputs=inputs), [monitor])
    assert judged.baseless == {violation.signature: "no message of 'b' came; known: c"}
    there = judge(trial_view([("b", {"y": 1.0})] * 3, inputs=inputs), [monitor])
    assert there.baseless == {}


def test_output_that_was_not_read_is_told() -> None:
    part = ComponentView("part", None, "", Path("/srv"), unread=5)
    judged = judge(replace(VIEW, components=[part]), [Never("alarm")])
    assert judged.broken == ("part: it wrote so much that the middle was not read",)
