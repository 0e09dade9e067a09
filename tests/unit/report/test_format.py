from __future__ import annotations

import math

import pytest

from riot_bus.report.format import clean, number, plural, seconds, share, share_interval, value


@pytest.mark.parametrize("text", ["\x1b[2J", "a\rb", "\u202eabc", "a\nb", "a\tb", "a\x00b", "\u2028"])
def test_nothing_moves_the_cursor_or_reorders_the_line(text: str) -> None:
    assert clean(text).isprintable()


def test_spaces_and_if_wanted_lines_stay() -> None:
    assert clean("a\N{NO-BREAK SPACE}b\N{THIN SPACE}c\u3000d") == "a\N{NO-BREAK SPACE}b\N{THIN SPACE}c\u3000d"
    assert clean("a\n\tb\r", lines=True) == "a\n\tb\\r"


def test_of_a_long_text_the_middle_is_left_out() -> None:
    text = clean("a" * 500 + "z" * 500, limit=50)
    assert len(text) == 50
    assert (text[0], text[-1]) == ("a", "z")
    assert clean("a" * 50, limit=50) == "a" * 50


@pytest.mark.parametrize(
    ("what", "text"),
    [("é\x1b", '"é\\u001b"'), ({"a": b"x"}, '{"a": "b\'x\'"}'), (1.5, "1.5"), (True, "True"), (b"\0", "b'\\x00'")],
)
def test_values_can_be_read_back(what: object, text: str) -> None:
    assert value(what) == text


@pytest.mark.parametrize(
    ("what", "text"),
    [
        (3.0, "3"),
        (123456789, "123456789"),
        (2.0**53, "9.0072e+15"),
        (math.pi, "3.14"),
        (12345.678, "12345.7"),
        (-0.00012345, "-0.000123"),
        (math.inf, "inf"),
        (math.nan, "nan"),
    ],
)
def test_numbers_are_short_but_integers_exact(what: float, text: str) -> None:
    assert number(what) == text


@pytest.mark.parametrize(
    ("rate", "text"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (1e-9, "< 0.1 %"),
        (1 - 1e-9, "> 99.9 %"),
        (0.034, "3.4 %"),
        (0.5, "50 %"),
        (0.995, "99.5 %"),
        (0.9994, "99.9 %"),
        (0.0006, "0.1 %"),
        (0.985, "98 %"),
    ],
)
def test_only_exact_rates_are_nothing_or_all(rate: float, text: str) -> None:
    assert share(rate) == text


def test_an_interval_has_its_unit_once() -> None:
    assert share_interval(0.0, 0.034) == "0 to 3.4 %"


def test_thousands_are_separated() -> None:
    assert [plural(1, "message"), plural(12345, "message")] == ["1 message", "12\N{NO-BREAK SPACE}345 messages"]


@pytest.mark.parametrize(
    ("duration", "text"),
    [
        (0.04, "0.0 s"),
        (9.94, "9.9 s"),
        (59.4, "59 s"),
        (60, "1 min"),
        (61.6, "1 min 2 s"),
        (3599.6, "1 h"),
        (3600 + 120, "1 h 2 min"),
        (math.inf, "?"),
    ],
)
def test_durations(duration: float, text: str) -> None:
    assert seconds(duration) == text
