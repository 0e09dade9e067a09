"""Errors in what components write are violations, and alike ones have one signature."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from riot_bus.monitors.forging import why_cannot_fire
from riot_bus.monitors.log import Log, normalized
from riot_bus.monitors.model import judge
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.monitors import trial_view

ROS = "[ERROR] [1718.25] [planner]: no path to (3.2, -4)"


def rosout(level: int, text: str) -> tuple[str, dict[str, object]]:
    return "/rosout", {"level": level, "name": "planner", "msg": text}


@pytest.mark.parametrize(
    ("line", "signature"),
    [
        (ROS, "log of planner: no path to (N, N)"),
        ("\x1b[31m" + ROS + "\x1b[0m", "log of planner: no path to (N, N)"),
        (
            "2026-01-01 12:00:00,123 ERROR nav: 'cmd_7' of 0xdeadbeef",
            "log of unit: N-N-N N:N:N,N ERROR nav: '...' of N",
        ),
        ("CRITICAL:root:cannot open /tmp/x_12/a.db:4 at all", "log of unit: CRITICAL:root:cannot open PATH at all"),
    ],
)
def test_an_error_line_is_found(line: str, signature: str) -> None:
    (found,) = Log().judge(trial_view([], errors=f"fine\n{line}\nfine\n"))
    assert found.signature == signature


def test_lines_that_differ_in_numbers_are_one_and_the_rest_is_bounded() -> None:
    many = "\n".join(f"ERROR: lap {number}" for number in range(100))
    assert len(Log().judge(trial_view([], errors=many))) == 1
    letters = "\n".join(f"ERROR: lap {chr(97 + n // 26)}{chr(97 + n % 26)}" for n in range(100))
    assert len(Log().judge(trial_view([], errors=letters))) == 20


def test_the_level_counts_for_words_and_for_rosout() -> None:
    warning, error = trial_view([rosout(30, "late by 3 ms")]), trial_view([rosout(40, "late by 3 ms")])
    assert Log().judge(warning) == []
    (found,) = Log(level="warn").judge(warning)
    assert (found.component, found.signature) == ("planner", "log of planner: late by N ms")
    assert Log().judge(error) != []
    assert Log(level="fatal").judge(trial_view([], errors="ERROR: x")) == []
    assert Log().judge(trial_view([], errors="0 errors, TERRORS, no Error")) == []
    both = trial_view([rosout(40, "no path to (1, 2)")], errors=ROS)
    assert len(Log().judge(both)) == 1, "a line and its message of /rosout are one"


def test_a_pattern_of_ones_own() -> None:
    view = trial_view([], errors="lost 12 frames\nERROR: x")
    (found,) = Log(pattern=r"lost \d+ frames").judge(view)
    assert found.signature == "log of unit: lost N frames"
    printed = replace(view, components=[replace(view.components[0], errors="", printed="lost 3 frames")])
    assert Log(pattern=r"lost \d+ frames").judge(printed)[0].signature == found.signature


@pytest.mark.parametrize("pattern", [r"(a+)+$", r"(?:a|b*){3}x", "a.*b.*c.*d", "a?" * 9, "(", r"((x*)y)+"])
def test_patterns_that_could_search_for_ever_are_refused(pattern: str) -> None:
    with pytest.raises(ConfigError, match="pattern"):
        Log(pattern=pattern)


@pytest.mark.parametrize("pattern", [r"(?i)fail(ed|ure)?: .*", r"[(*+]{1,2}x", r"a\(b\)*", r"^\[E\].*(lost|late)$"])
def test_usual_patterns_are_not(pattern: str) -> None:
    Log(pattern=pattern)


def test_the_worst_line_takes_little_time() -> None:
    begin = time.process_time()
    Log(pattern="a.*b.*c").judge(trial_view([], errors="ab" * 100_000))
    normalized("/" * 400 + "'" * 400 + "0x" * 400)
    assert time.process_time() - begin < 2.0


def test_it_can_fire_or_says_why_not() -> None:
    view = trial_view([], errors="all is well")
    assert why_cannot_fire(Log(), view) is None
    assert why_cannot_fire(Log(pattern="frames lost"), view) is None
    assert "no text is known" in (why_cannot_fire(Log(pattern=r"[0-9]{3}"), view) or "")
    assert judge(trial_view([]), [Log()]).unseen == ("Log /rosout: no component wrote anything",)
