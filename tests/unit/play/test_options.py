from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.log.naming import parse_remaps, parse_time
from riot_bus.play.options import PlayOptions, parse_latched
from riot_bus.vocabulary.errors import ConfigError

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND


def check(**options):
    PlayOptions(**{"logs": [Path("a.mcap")], **options}).check()


def test_usual_options_are_usable():
    check()
    check(rate=0.0, duration=0.0, clock=1000.0, name="rover-1.b_c", delay=5.0, lockstep=["a"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"logs": []}, "no log to play is named"),
        ({"rate": float("nan")}, "not a speed"),
        ({"rate": 1e-300}, "not a speed"),
        ({"rate": 1e300}, "not a speed"),
        ({"delay": -1.0}, "--delay"),
        ({"start_offset": 1e300}, "--start-offset"),
        ({"settle_timeout": float("inf")}, "--settle-timeout"),
        ({"wait": float("nan")}, "--wait"),
        ({"clock": 1001.0}, "1001 Hz is too high"),
        ({"duration": 1.0, "until": "1"}, "choose one"),
        ({"ack": "a", "lockstep": ["b"]}, "choose one"),
        ({"name": ""}, "is not a name"),
        ({"name": "a/b"}, "is not a name"),
        ({"name": "*"}, "is not a name"),
    ],
)
def test_others_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        check(**options)


def test_remaps():
    assert parse_remaps(["/a:=/b", "x/**:=y/**", "0/a/p::msg::dds_::T_/h:=/c"]) == {
        "/a": "/b",
        "x/**": "y/**",
        "0/a/p::msg::dds_::T_/h": "/c",
    }


@pytest.mark.parametrize("text", ["", "a", "a=b", ":=b", "a:=", "/:=b", "a/**:=b", "a:=b/**"])
def test_what_is_no_remap(text):
    with pytest.raises(ConfigError, match="what to rename"):
        parse_remaps([text])


def test_latched():
    assert parse_latched(["/map", "a=b=3", "/tf_static=1048576"]) == {"/map": 1, "a=b": 3, "/tf_static": 1 << 20}


@pytest.mark.parametrize("text", ["", "=1", "/map=", "/map=0", "/map=-1", "/map=1048577", "/map=x"])
def test_what_is_not_to_be_latched(text):
    with pytest.raises(ConfigError, match="what to latch"):
        parse_latched([text])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0", BEGIN),
        ("2.5", BEGIN + 2_500_000_000),
        ("1700000001.5", BEGIN + 1_500_000_000),
        ("2023-11-14T22:13:21", BEGIN + SECOND),
        ("2023-11-14 23:13:21+01:00", BEGIN + SECOND),
        ("2023-11-14T22:13:21Z", BEGIN + SECOND),
    ],
)
def test_until(text, expected):
    assert parse_time(text, BEGIN, where="--until") == expected


@pytest.mark.parametrize("text", ["", "soon", "-1", "nan", "inf", "1e300", "2023-13-01"])
def test_what_is_no_time(text):
    with pytest.raises(ConfigError, match="is no time"):
        parse_time(text, BEGIN, where="--until")


@given(st.datetimes(datetime(1980, 1, 1), datetime(2200, 1, 1)), st.integers(-14, 14))
def test_until_any_moment(moment, hours):
    moment = moment.replace(tzinfo=timezone(timedelta(hours=hours)))
    exact = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
    assert abs(parse_time(moment.isoformat(), 0, where="--until") - exact) <= 2000
