from __future__ import annotations

from typing import Any

import pytest

from riot_bus.pipeline.runner import Counts
from riot_bus.router.counts import ForwarderCounts, Losses, RouteCounts, TopicCounts, count

NOTHING: dict[str, dict[str, int]] = {
    "passed": {},
    "shed": {},
    "undelivered": {},
    "held": {},
    "recorded": {},
    "unrecorded": {},
}


def balanced(each: TopicCounts) -> bool:
    return each.received + each.added == each.forwarded + each.dropped + each.lost + each.held


def test_each_message_is_in_exactly_one_place() -> None:
    looked_at = {"/b": Counts(seen=10, changed=3, dropped=2, copies=1, added=4, delivered=13)}
    table = count(
        looked_at,
        passed={"/b": 5, "/a": 7},
        shed={"/a": 2},
        undelivered={"/b": 1},
        held={"/b": 3},
        recorded={"/b": 14},
        unrecorded={"/c": 1},
    )
    assert list(table) == ["/a", "/b", "/c"]
    assert table["/a"] == TopicCounts(received=9, forwarded=7, lost=2)
    expected = {"received": 15, "changed": 3, "added": 5, "forwarded": 14, "dropped": 2, "lost": 1, "held": 3}
    assert table["/b"] == TopicCounts(**expected, recorded=14)
    assert table["/c"] == TopicCounts(unrecorded=1)
    assert all(map(balanced, table.values()))


def test_topics_of_which_nothing_was_seen_are_left_out() -> None:
    assert count({"/quiet": Counts(), "/made": Counts(added=1, delivered=1)}, **NOTHING).keys() == {"/made"}


@pytest.mark.parametrize("what", [{"messages": {"/a": 1}}, {"recordings": {"/a": 1}}, {"links": ("broken",)}])
def test_losses_of_any_kind_are_losses(what: dict[str, Any]) -> None:
    assert Losses(**what)
    assert not Losses(reasons={"slow": 1})


def test_counts_of_present_and_ended_routes_add_up() -> None:
    counts = ForwarderCounts(lambda key, number: None)
    ended, present, silent = RouteCounts("a"), RouteCounts("a"), RouteCounts("b")
    ended.passed, ended.seen, ended.rewritten = 3, 2, 1
    present.passed, present.seen = 10, 20
    counts.end(ended)
    assert counts.passed([present, silent]) == {"a": 13}
    assert counts.received([present, silent]) == {"a": 36}
    assert counts.passed([]) == {"a": 3}


def test_rewritten_messages_are_reported_once() -> None:
    told: list[tuple[str, int]] = []
    counts = ForwarderCounts(lambda key, number: told.append((key, number)))
    route = RouteCounts("a")
    counts.report(route)
    route.rewritten = 4
    counts.report(route)
    counts.report(route)
    route.rewritten = 5
    counts.end(route)
    assert told == [("a", 4), ("a", 1)]


def test_an_interceptor_that_cannot_count_does_not_end_the_forwarder(caplog: pytest.LogCaptureFixture) -> None:
    def refuse(key: str, number: int) -> None:
        raise ZeroDivisionError

    route = RouteCounts("a")
    route.rewritten = 1
    counts = ForwarderCounts(refuse)
    counts.end(route)
    assert counts.received([]) == {"a": 1}
    assert "an interceptor of a could not count" in caplog.text
