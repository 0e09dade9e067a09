from __future__ import annotations

from riot_bus_fleet.logs.entry import LogEntry, TopicEntry
from riot_bus_fleet.logs.index import IndexReport
from riot_bus_fleet.logs.text import index_line, list_lines, show_lines

LOG = LogEntry(
    place="/logs/\x1b[31mred.mcap",
    size=3 << 20,
    stamp="1",
    robot="r7\n",
    start=1_700_000_000 * 10**9,
    end=1_700_000_090 * 10**9,
    messages=12,
    topics=(TopicEntry("/odom", "odom", "nav_msgs/msg/Odometry", "cdr", 10, 2), TopicEntry("x", "x", "", "json", 2)),
    metadata={"seed": "4", "note": "a\x07b"},
    number=3,
)


def test_a_table_of_logs() -> None:
    empty = LogEntry(
        place="/e.mcap", size=0, stamp="", robot="r1", readable=False, problem="not an MCAP file", number=12
    )
    late = LogEntry(place="/f.mcap", size=1, stamp="", robot="r1", start=2**63 - 1, end=2**63 - 1, lost=1, gone=True)
    assert list_lines([LOG, empty, late]) == [
        "    robot  begin (UTC)          length  messages    size             log",
        " 3  r7\\n   2023-11-14 22:13:20  90.0 s        12  3.1 MB             /logs/\\x1b[31mred.mcap",
        "12  r1     -                     0.0 s         0     0 B  not a log  /e.mcap",
        " 0  r1     2262-04-11 23:47:16   0.0 s         0     1 B  gone       /f.mcap",
    ]


def test_one_log() -> None:
    assert show_lines(LOG) == [
        "log 3: /logs/\\x1b[31mred.mcap",
        "robot r7\\n (as the folder says), 3.1 MB, profile -",
        "2023-11-14 22:13:20 to 2023-11-14 22:14:50 UTC, 90.000 s, 12 messages",
        "note: a\\x07b",
        "seed: 4",
        "  /odom         10  nav_msgs/msg/Odometry, 2 originals",
        "  x              2  json",
    ]


def test_what_indexing_has_come_to() -> None:
    assert index_line(IndexReport(5, 2)) == "5 logs: 2 read, 3 known already"
    assert index_line(IndexReport(5, 5, 1, 2, 3)) == (
        "5 logs: 5 read, 0 known already, 1 of those read are damaged (riot fleet list damaged), 2 gone, 3 forgotten"
    )
