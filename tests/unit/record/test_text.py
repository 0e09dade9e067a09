from __future__ import annotations

from riot_bus.log.account import Account
from riot_bus.record.rotating_sink import FileResult
from riot_bus.record.service import CaptureResult
from riot_bus.record.text import account_lines, answer_lines, progress_line, result_lines

STATUS = {
    "name": "recorder",
    "version": "1",
    "pid": 7,
    "endpoint": "tcp/x",
    "state": "recording",
    "seconds": 3.2,
    "messages": 10,
    "bytes": 2_500_000,
    "lost": 2,
    "reasons": {"disk": 2},
    "left_out": {"paused": 4},
    "connected": False,
    "problem": "no\x1b[2J space",
    "file": "a.mcap",
    "ring": {"messages": 3, "seconds": 1.5},
}


def test_what_is_going_on_is_one_line() -> None:
    assert progress_line(STATUS) == (
        "● recording, 3 s, 10 messages, 2.5 MB, ring: 3 messages, 1.5 s, 2 LOST (disk: 2), NOT CONNECTED, "
        "ALARM: no\\x1b[2J space"
    )
    assert answer_lines(STATUS)[-1] == "left out: paused: 4"
    assert answer_lines({"dumped": "x.mcap"}) == ["wrote x.mcap"]


def test_a_summary_names_files_and_what_is_missing_by_topic() -> None:
    account = Account({"/a": 9, "/b": 1}, {"disk": {"/a": 2}}, {"paused": {"/b": 3}})
    lines = result_lines(CaptureResult([FileResult("a.mcap", 1000, account)], account, 2.0))
    assert lines[:2] == ["recorded 10 messages of 2 topics in 2.0 s", "  a.mcap: 10 messages, 1.0 kB, 2 lost"]
    assert [line.split() for line in lines[2:]] == [
        ["topic", "recorded", "disk", "(paused)"],
        ["/a", "9", "2", "0"],
        ["/b", "1", "0", "3"],
    ]
    assert account_lines(Account({"/a": 1})) == []


def test_a_summary_says_which_files_are_gone_and_what_never_came() -> None:
    account = Account({"/a": 9})
    files = [FileResult(f"{n}.mcap", 1000, account, deleted=n < 2) for n in range(3)]
    assert result_lines(CaptureResult(files, account, 2.0, silent=["/b", "x\x1b/**"]))[1:] == [
        "  2.mcap: 9 messages, 1.0 kB",
        "  2 older files with 18 messages are deleted (--max-files)",
        "nothing came on /b",
        "nothing came on x\\x1b/**",
    ]
    assert [each.row().get("deleted", False) for each in files] == [True, True, False]
