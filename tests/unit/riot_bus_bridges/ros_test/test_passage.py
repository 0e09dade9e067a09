from __future__ import annotations

from typing import Any

import pytest

from riot_bus.processes.placement import StartedProcesses
from riot_bus.router.counts import Losses, TopicCounts
from riot_bus.zenoh.link_watch import BrokenLink
from riot_bus_bridges.ros_test.passage import Passage

ODOM = TopicCounts(received=12, changed=3, forwarded=10, dropped=2, recorded=12)


def passage(**more: Any) -> Passage:
    given: dict[str, Any] = {
        "wanted": ["/odom"],
        "counts": {"/odom": ODOM, "/map": TopicCounts(recorded=1)},
        "crossed": 12,
        "losses": Losses(),
        "components": {"system": 2, "unit": 1},
        "nodes": "planner",
        "started": StartedProcesses({"planner": 1}, {"amcl": 2}),
    }
    return Passage(**{**given, **more})


def test_one_line_of_what_passed() -> None:
    assert passage(recording="run.mcap", hits=[2, 1]).lines() == [
        "12 messages of 1 topic intercepted: 3 changed, 10 delivered, 2 dropped, 0 added, 0 held, 0 lost; "
        "3 injections carried out; recording run.mcap (13 messages)",
        "in segment unit: planner",
    ]


def test_losses_are_loud() -> None:
    losses = Losses({"/odom": 2}, {"/map": 1}, (BrokenLink("unit", "abcd", 0, "stalled"),), {"no room": 2})
    assert passage(losses=losses).lines()[2:] == [
        "LOST: 2 messages (no room: 2)",
        "LOST: 1 message not recorded",
        f"LOST: {losses.links[0]}",
    ]


def test_interceptors_that_fail_are_told_and_nothing_else_makes_the_result_empty() -> None:
    errors = {"set": (12, "PayloadError: no such field")}
    line = "interceptor set failed on 12 messages: PayloadError: no such field"
    found = passage(errors=errors)
    assert (found.lines()[1], found.vacuous) == (line, "")
    found = passage(errors=errors, counts={"/odom": TopicCounts(received=12, forwarded=12)})
    assert found.lines()[1:] == [line, "in segment unit: planner", found.vacuous]
    assert found.vacuous.startswith("NOTHING WAS CHANGED: ")


def test_nothing_to_intercept_is_no_fault() -> None:
    found = passage(wanted=[], counts={}, crossed=0)
    assert (found.lines(), found.vacuous) == (["nothing was to be intercepted", "in segment unit: planner"], "")


EMPTY = StartedProcesses({}, {"amcl": 2, "git": 1})


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            {"crossed": 0, "started": EMPTY},
            [
                "NOTHING WAS INTERCEPTED: 12 messages of /odom came, and none had a receiver in another segment",
                "  hint: no process is called 'planner'; started were: amcl (2 times), git",
            ],
        ),
        (
            {
                "crossed": 0,
                "counts": {},
                "nodes": None,
                "components": {"system": 2},
                "started": StartedProcesses({}, {}),
            },
            [
                "NOTHING WAS INTERCEPTED: 0 messages of /odom came",
                "  hint: all processes are in the segment system: name those for the segment unit with --unit-nodes",
            ],
        ),
        (
            {"crossed": 0, "started": StartedProcesses({}, {})},
            [
                "NOTHING WAS INTERCEPTED",
                "  hint: no process is called 'planner'; started were: nothing that Python has",
            ],
        ),
        ({"hits": [0, 0]}, ["NOTHING WAS INJECTED"]),
        (
            {"wanted": [], "counts": {}, "crossed": 0, "components": {}},
            ["NOTHING USED THIS ROUTER", "  hint: no component has connected to this router: nodes of DDS need --dds"],
        ),
    ],
)
def test_what_shows_nothing_is_loud_and_says_why(more: dict[str, Any], words: list[str]) -> None:
    found = passage(**more)
    assert found.vacuous
    lines = [line for line in found.lines()[1:] if not line.startswith("in segment")]
    assert len(lines) == len(words)
    assert all(line.startswith(begin) for line, begin in zip(lines, words, strict=True))


def test_calls_of_services_have_crossed() -> None:
    found = passage(wanted=["/add/@reply"], counts={"/add/@reply": TopicCounts(received=1, forwarded=1)}, crossed=0)
    assert not found.vacuous


def test_behind_bridges_no_component_is_seen() -> None:
    found = passage(wanted=[], counts={}, crossed=0, components={}, domains={"system": 4, "unit": 7})
    assert not found.vacuous


def test_names_from_elsewhere_do_not_command_a_terminal() -> None:
    found = passage(started=StartedProcesses({"\x1b[31mred": 1}, {}), problems={"/o\x07dom": "no such field"})
    assert found.lines()[1:] == ["not injected: /o\\x07dom: no such field", "in segment unit: \\x1b[31mred"]
