from riot_bus.play.service import PlayResult
from riot_bus.play.text import progress_line, result_line, speed, status_lines

STATUS = {
    "name": "one",
    "pid": 77,
    "logs": ["a.mcap", "b\x1b[31m.mcap"],
    "state": "paused",
    "position": 1.25,
    "end": 10.0,
    "rate": 0.5,
    "loop": False,
    "pass": 1,
    "published": 3,
    "lost": 0,
    "lateness": {"p50": 0.0001, "p99": 0.002, "max": 0.03},
    "unsettled": 0,
}


def test_speed():
    assert [speed(rate) for rate in (0.0, 1.0, 0.1, 50.0)] == ["as fast as possible", "1x", "0.1x", "50x"]


def test_progress():
    assert progress_line(STATUS) == "⏸ paused, 1.2 of 10.0 s, 0.5x, 3 messages"
    more = {**STATUS, "state": "playing", "loop": True, "pass": 2, "lost": 4, "unsettled": 1}
    expected = "▶ playing, 1.2 of 10.0 s, 0.5x, 3 messages, pass 2, 4 lost, 1 time no subscriber settled in time"
    assert progress_line(more) == expected


def test_status_shows_nothing_that_a_terminal_obeys():
    lines = status_lines(STATUS)
    assert lines[0].startswith("player one, process 77: a.mcap, b")
    assert "\x1b" not in "".join(lines)
    assert lines[1] == "paused, 1.2 of 10.0 s, 0.5x, 3 messages"
    assert lines[2] == "late by 0.10 ms (median), 2.00 ms (99 %), 30.00 ms (most)"


def test_result():
    late = {"p50": 0.0, "p99": 0.0, "max": 0.0}
    assert result_line(PlayResult(7, 1.5, 1, lateness=late)) == "played 7 messages in 1.50 s"
    more = PlayResult(7, 1.5, 3, stopped=True, lateness={**late, "max": 0.001}, unsettled=2)
    expected = "played 7 messages in 1.50 s, 3 passes; late by 0.00 ms (median), 0.00 ms (99 %), 1.00 ms (most)"
    assert result_line(more) == f"{expected}; 2 times no subscriber settled in time; stopped before the end"


def test_a_result_is_good_if_nothing_is_missing():
    assert PlayResult(7, unsettled=1, stopped=True)
    assert not PlayResult(7, unread={"a.mcap": "the file was not closed"})
    assert not PlayResult(7, problems={"link": "broke"})
