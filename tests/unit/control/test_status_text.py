from __future__ import annotations

from dataclasses import asdict
from typing import Any

from riot_bus.control.status_text import answer_lines, bypass_lines, counts_lines, status_lines
from riot_bus.router.counts import TopicCounts

NO_LOSS: dict[str, Any] = {"messages": 0, "recordings": 0, "reasons": {}, "links": []}
QUIET: dict[str, Any] = {
    "name": "base",
    "version": "1.0",
    "pid": 7,
    "uptime": 12.6,
    "warnings": [],
    "bypasses": [],
    "losses": NO_LOSS,
    "segments": {},
    "controlled_from": [],
    "intercepted": [],
    "interceptors": [],
    "plan": None,
    "recording": None,
    "counts": {},
}
PLAN: dict[str, Any] = {"name": "p.toml", "injections": 1, "hits": 2, "skipped": 0, "problems": {}}
RECORDING = {"file": "a.mcap", "messages": 1, "lost": 0, "seconds": 3.2}


def test_a_quiet_router_needs_three_lines() -> None:
    assert status_lines(QUIET) == [
        "router base, riot_bus 1.0, process 7, up for 13 s",
        "intercepted: nothing",
        "recording: no",
    ]


def test_what_is_wrong_comes_before_what_there_is() -> None:
    bypass = {
        "components": [{"name": "a", "segment": "in"}, {"name": "b", "segment": ""}],
        "active": True,
        "evidence": "a link",
        "cure": "close it",
    }
    link = {"segment": "in", "peer": "tcp/x", "reason": "timeout"}
    losses = {"messages": 3, "recordings": 1, "reasons": {"late": 2, "full": 1}, "links": [link]}
    components = [{"mode": "", "zid": "aa", "name": ""}, {"mode": "peer", "zid": "bb", "name": "nav"}]
    segments = {
        "in": {"endpoints": ["tcp/a:1", "tcp/b:2"], "components": components},
        "out": {"endpoints": [], "components": []},
    }
    status = QUIET | {
        "warnings": ["old Zenoh"],
        "bypasses": [bypass],
        "losses": losses,
        "segments": segments,
        "controlled_from": ["in"],
        "intercepted": ["/a", "/b"],
        "services": ["/call"],
        "recording": RECORDING | {"problem": "disk full"},
    }
    assert status_lines(status)[1:] == [
        "warning: old Zenoh",
        "bypass: a way around the router is used: a (in) and b (no segment): a link",
        "  hint: close it",
        "lost: 3 messages (late: 2, full: 1)",
        "lost: 1 message not recorded",
        "lost: segment in: link to tcp/x broke (timeout)",
        "segment in (control): tcp/a:1 tcp/b:2",
        "  component aa",
        "  peer bb nav",
        "segment out: ",
        "intercepted: /a, /b",
        "intercepted services: /call",
        "recording: a.mcap (1 message, 0 lost, 3 s); disk full",
    ]
    (line, _) = bypass_lines([bypass | {"active": False}])
    assert "is open" in line


def test_interceptors_tell_when_they_act_and_how_they_failed() -> None:
    calm = {"name": "log", "topics": None, "conditions": {}, "bypassed": "", "errors": 0, "place": "", "error": ""}
    wild = calm | {
        "name": "mine",
        "topics": ["/a", "/b"],
        "conditions": {"first": 3},
        "bypassed": "too slow",
        "errors": 2,
        "error": "KeyError: 1",
    }
    lines = status_lines(QUIET | {"interceptors": [calm, wild, wild | {"place": "a.py:3", "bypassed": ""}]})
    assert lines[2:8] == [
        "interceptor log",
        "interceptor mine on /a, /b first=3",
        "  too slow",
        "  errors: 2, last at an unknown place; first: KeyError: 1",
        "interceptor mine on /a, /b first=3",
        "  errors: 2, last at a.py:3; first: KeyError: 1",
    ]


def test_answers_say_what_was_changed() -> None:
    assert answer_lines({"intercepted": []}) == ["intercepted: nothing"]
    assert answer_lines({"plan": None}) == ["no plan"]
    assert answer_lines({"plan": PLAN | {"skipped": 4, "problems": {"/a": "no field"}}}) == [
        "plan p.toml: 1 injection, carried out 2 times, 4 skipped",
        "  /a: no field",
    ]
    assert answer_lines(RECORDING) == ["recorded: a.mcap (1 message, 0 lost, 3 s)"]
    assert answer_lines({"former": "a.mcap", "file": "b.mcap"}) == ["finished: a.mcap", "recording: b.mcap"]
    assert answer_lines({"former": RECORDING}) == []


def test_no_control_character_of_the_network_reaches_a_terminal() -> None:
    evil = "a\x1b[2J\n"
    row = asdict(TopicCounts())
    found = [
        *status_lines(QUIET | {"name": evil, "warnings": [evil], "counts": {evil: row}}),
        *counts_lines({"counts": {evil: row}, "losses": NO_LOSS}),
        *answer_lines({"file": evil}),
    ]
    assert all(line.isprintable() for line in found)
    assert sum("\\x1b[2J" in line for line in found) == 5
