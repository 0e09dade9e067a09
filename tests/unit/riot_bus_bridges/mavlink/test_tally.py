"""What a bridge counts and says."""

from __future__ import annotations

from riot_bus_bridges.links.end import End
from riot_bus_bridges.links.link import Link
from riot_bus_bridges.mavlink.tally import LinkTally, ready_line, summary_lines
from riot_bus_bridges.mavlink.url import parse_link
from riot_bus_mavlink.frame import Framer
from tests.unit.riot_bus_bridges.links.hosts import KeepingHost
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of

SPEC = parse_link("a/fc=tcpin:127.0.0.1:5760")


class Idle(Link):
    """A link that does nothing."""

    def __init__(self) -> None:
        super().__init__(SPEC, KeepingHost())
        self.packets = 3

    def dropped(self) -> int:
        return self.packets

    def close(self) -> None:
        self.packets = 0


def end_of(address: str, *, room: int) -> End:
    sent: list[bytes] = []

    def write(data: bytes) -> bool:
        sent.append(data)
        return len(sent) <= room

    return End(SPEC, address, Framer(COMMON.crc_extra), write)


def test_counts_of_ends_that_are_gone_are_kept() -> None:
    tally, link = LinkTally(SPEC), Idle()
    one, two = end_of("one", room=1), end_of("two", room=9)
    for end in (one, two):
        tally.join(end)
        for sequence in (1, 2, 5):
            for frame in end.framer.feed(frame_of(sequence=sequence).raw):
                end.losses.see(frame.system, frame.component, frame.sequence)
        for _ in range(3):
            end.send(b"frame")
    one.framer.feed(b"\xfd\xff")
    before = tally.status(link)
    tally.leave(one)
    after = tally.status(link)
    assert [end["address"] for end in before["ends"]] == ["one", "two"]
    assert [end["address"] for end in after["ends"]] == ["two"]
    for status in (before, after):
        assert (status["frames"], status["out"], status["lost_out"]) == (6, 4, 2)
        assert status["sources"] == {"1/1": {"received": 6, "lost": 4}}
    assert after["bytes"] == after["frame_bytes"] + after["junk_bytes"]
    assert after["junk_bytes"] == 2
    tally.end(link)
    link.close()
    assert tally.status(link)["dropped_packets"] == 3


def test_words() -> None:
    link = {
        **{"kind": "tcp server", "where": "127.0.0.1:5760", "segment": "a", "state": "listening"},
        **{"in": 12034, "out": 5, "lost_out": 1, "bad_crc": 2, "junk_bytes": 31, "dropped_packets": 7, "duplicate": 4},
        "sources": {"1/1": {"received": 9, "lost": 3}, "1/2": {"received": 9, "lost": 1}},
    }
    status = {
        "segments": {
            "a": {"endpoint": "tcp/127.0.0.1:7447", "to_bus": 12034, "from_bus": 5, "inserted": 2, "unrouted": 0},
            "b": {"endpoint": "tcp/127.0.0.1:7448"},
        },
        "links": {"fc": link},
    }
    assert ready_line(status) == (
        "ready: fc (tcp server 127.0.0.1:5760) and a (tcp/127.0.0.1:7447); nothing and b (tcp/127.0.0.1:7448)"
    )
    assert summary_lines(status) == [
        "fc: 7 packets came faster than they were taken, and were lost",
        "fc: 4 duplicates were dropped",
        "a: 12034 frames to the bus, 5 from it (2 inserted)",
        "b: 0 frames to the bus, 0 from it",
        "       in  out  lost before  not sent  bad checksum  junk bytes",
        "fc  12034    5            4         1             2          31",
    ]
