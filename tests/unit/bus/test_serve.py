from __future__ import annotations

import pytest

from riot_bus.bus.router import Losses, TopicCounts
from riot_bus.bus.serve import count_table, parse_segments, parse_types
from riot_bus.bus.watch import BrokenLink, TransportWatch
from riot_bus.errors import ConfigError


def test_segments() -> None:
    texts = ["a=tcp/127.0.0.1:1,tcp/[::1]:1", "b=tcp/h:2#iface=lo", "a=udp/127.0.0.1:3"]
    assert parse_segments(texts) == {
        "a": ["tcp/127.0.0.1:1", "tcp/[::1]:1", "udp/127.0.0.1:3"],
        "b": ["tcp/h:2#iface=lo"],
    }


@pytest.mark.parametrize("text", ["", "a", "a=", "=tcp/x:1", "a=7447"])
def test_wrong_segments(text: str) -> None:
    with pytest.raises(ConfigError, match="write NAME=ENDPOINT"):
        parse_segments([text])


def test_types() -> None:
    assert parse_types(["/odom=nav_msgs/msg/Odometry"]) == {"/odom": "nav_msgs/msg/Odometry"}
    with pytest.raises(ConfigError, match="TOPIC=TYPE"):
        parse_types(["odom"])


def test_table_is_aligned() -> None:
    lines = count_table({"a": TopicCounts(seen=10_000), "long/topic": TopicCounts(lost=2)})
    assert lines == [
        "topic        seen  changed  dropped  added  delivered  recorded  lost",
        "a           10000        0        0      0          0         0     0",
        "long/topic      0        0        0      0          0         0     2",
    ]


def test_watch_tells_leaving_from_breaking() -> None:
    longest = {"s": 0.0}
    watch = TransportWatch(1.0, junction=lambda: "now", ours={"former", "now"}, longest=longest.__getitem__)
    for peer in ("former", "left", "back"):
        watch.event("s", peer, opened=True)
        watch.event("s", peer, opened=False)
    assert (watch.departures, watch.broken) == (2, [])
    watch.event("s", "back", opened=True)
    watch.event("s", "now", opened=False)
    longest["s"] = 0.9
    watch.event("s", "slow", opened=False)
    assert [(link.peer, link.reason) for link in watch.broken] == [
        ("back", "reconnected"),
        ("now", "junction"),
        ("slow", "stalled"),
    ]
    assert watch.departures == 1
    watch.stop()
    watch.event("s", "now", opened=False)
    assert len(watch.broken) == 3


def test_losses_are_true_when_something_was_lost() -> None:
    assert not Losses()
    assert Losses({"a": 1})
    assert Losses(recordings={"a": 1})
    assert Losses(links=(BrokenLink("s", "p", 0, "stalled"),))
