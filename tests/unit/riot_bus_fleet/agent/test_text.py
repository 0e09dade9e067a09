from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from riot_bus_fleet.agent.remote_operation import Robot
from riot_bus_fleet.agent.text import log_lines, operation_line, robot_lines, silence_line, status_lines

PLAY: dict[str, Any] = {
    "state": "playing", "kind": "play", "logs": ["a.mcap"], "position": 1.25, "end": 4.0, "rate": 2.0, "published": 7,
    "lost": 0, "who": "ann@desk", "on_lost_controller": "stop", "grace": 10.0, "controller_away": 3.2,
    "warnings": ["odd\x1b[2J"], "reason": "", "problem": None,
}  # fmt: skip
STATUS = {
    "robot": "r7", "version": "0.1.0", "pid": 5, "uptime": 9.9, "bus": "tcp/127.0.0.1:7447", "busy": True,
    "operation": PLAY,
}  # fmt: skip


def test_a_status() -> None:
    assert status_lines(STATUS) == [
        "r7: riot_bus 0.1.0, process 5, up for 10 s, bus tcp/127.0.0.1:7447",
        "playing play a.mcap, 1.2 of 4.0 s, 2x, 7 messages",
        "for ann@desk; stops if the controller is lost for 10 s (not seen for 3 s)",
        "warning: odd\\x1b[2J",
    ]
    assert status_lines({**STATUS, "operation": None})[1:] == ["idle"]


def test_ends() -> None:
    ended = {**PLAY, "state": "failed", "lost": 2, "problem": {"message": "nobody answers"}}
    assert operation_line(ended) == "failed play a.mcap, 1.2 of 4.0 s, 2x, 7 messages, 2 lost, nobody answers"
    assert operation_line({**PLAY, "state": "stopped", "reason": "stopped by bob"}).endswith(", stopped by bob")
    assert silence_line(2.4) == "nothing heard for 2 s; trying on"


def test_robots() -> None:
    idle = {**STATUS, "busy": False}
    assert robot_lines([Robot("a", 1, STATUS), Robot("b", 1, idle), Robot("c", 1, None), Robot("d", 2, STATUS)]) == [
        "a: playing play a.mcap, 1.2 of 4.0 s, 2x, 7 messages",
        "b: idle",
        "c: there, but does not answer",
        "d: 2 agents have this name: none of them plays or records",
    ]


def test_logs() -> None:
    row = {"name": "a.mcap", "start": 1_700_000_000 * 10**9, "seconds": 4.5, "messages": 12, "lost": 0, "problem": ""}
    assert log_lines({"logs": [row, {**row, "problem": "cut"}], "count": 3, "complete": False}) == [
        "2023-11-14 22:13:20       4.5 s         12 messages  a.mcap",
        "2023-11-14 22:13:20       4.5 s         12 messages  a.mcap  cut",
        "and 1 more",
        "it is still looking at its logs; ask again for the rest",
    ]
    assert log_lines({"logs": [], "count": 0, "complete": True}) == ["no log"]


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from([*PLAY, *STATUS, "name", "count", "complete", "start", "seconds"]), _JSON))
def test_whatever_comes_from_the_network_is_shown(document: dict[str, Any]) -> None:
    lines = [
        *status_lines(document),
        operation_line(document),
        *robot_lines([Robot("r", 1, document)]),
        *log_lines(document),
        *log_lines({"logs": [document]}),
    ]
    assert all(line.isprintable() for line in lines)
