"""What `riot router` says at its end and does meanwhile; service and clock are doubles."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.control import router_process
from riot_bus.control.reach import Bypass
from riot_bus.control.router_process import Upkeep, report_end
from riot_bus.control.terminal import Foreground
from riot_bus.graph.model import ConnectedComponent
from riot_bus.router.counts import Losses, TopicCounts
from riot_bus.vocabulary.errors import DataLossError
from riot_bus.zenoh.link_watch import BrokenLink


def ended(losses: Losses, *, as_json: bool = False) -> tuple[list[str], str]:
    """Return what a router prints at its end, and how it fails."""
    said: list[str] = []
    bus = SimpleNamespace(counts=lambda: {"/a\x1b": TopicCounts(received=2, forwarded=2)}, losses=losses)
    service: Any = SimpleNamespace(bus=bus, pipeline=SimpleNamespace(stages=[], errors={}))
    try:
        report_end(service, Foreground(said.append, said.append, as_json=as_json))
    except DataLossError as error:
        return said, error.message
    return said, ""


def test_a_router_without_losses_ends_with_its_counts() -> None:
    said, problem = ended(Losses())
    assert problem == ""
    assert said[1].split()[:2] == ["/a\\x1b", "2"]
    (line,) = ended(Losses(), as_json=True)[0]
    document = json.loads(line)
    assert (document["event"], document["counts"]["/a\x1b"]["balanced"]) == ("ended", True)


def test_losses_are_summed_up_with_their_reasons() -> None:
    link = BrokenLink("in", "tcp/x:1", 0, "stalled")
    losses = Losses(messages={"/a": 1, "/b": 2}, recordings={"/a": 4}, reasons={"full": 3}, links=(link,))
    assert ended(losses)[1] == f"7 messages were lost (full: 3); {link}"
    assert ended(Losses(recordings={"/a": 2}))[1] == "2 messages were lost"
    assert ended(Losses(links=(link,)))[1] == str(link)


def test_the_alarm_tells_open_ways_and_that_they_are_closed() -> None:
    warned: list[str] = []
    alarm = router_process._alarm(warned.append)
    alarm([Bypass("direct", (ConnectedComponent("in", "aa"), ConnectedComponent("out", "bb")), "a link", "cut it")])
    alarm([])
    assert warned == [
        "bypass: a way around the router is used: aa (in) and bb (out): a link",
        "  hint: cut it",
        "bypass: the ways around the router are closed",
    ]


def test_upkeep_looks_at_memory_each_time_but_gives_it_back_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, log = SimpleNamespace(now=100.0), list[str]()
    monkeypatch.setattr(router_process, "time", SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setattr(router_process, "memory_limit", lambda: 7)
    monkeypatch.setattr(router_process, "check_memory", lambda limit: log.append(f"memory {limit}"))
    monkeypatch.setattr(router_process, "trim_heap", lambda: log.append("trim"))
    monkeypatch.setattr(router_process, "force_end_after", lambda seconds: log.append("alive"))
    monkeypatch.setattr(router_process, "LoadScheduling", lambda: lambda: log.append("schedule"))
    upkeep = Upkeep()
    assert log == ["alive"]
    for _ in range(5):
        clock.now += 10
        upkeep()
    assert log.count("memory 7") == log.count("schedule") == 5
    assert log.count("trim") == 1
    assert log.count("alive") == 2
