from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.naming import in_full, means, parse_remaps, parse_time, renamed
from riot_bus.types.capabilities import RecordedTopic
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.adapter import MavlinkAdapter

ODOM = RecordedTopic("/robot1/odom", "0/robot1/odom/nav::O_/H", True, Schema("", "", b""), "cdr")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/robot1/odom", True),
        ("robot1/odom", True),
        ("0/robot1/odom/nav::O_/H", True),
        ("/robot1/*", True),
        ("*/robot1/odom/**", True),
        ("**", True),
        ("/odom", False),
        ("/robot1", False),
        ("/robot*", False),
    ],
)
def test_names_keys_and_expressions_mean_a_topic(text, expected):
    assert means(text, ODOM) is expected


def test_short_names_stand_for_keys_that_were_recorded():
    key = "mavlink_raw/fc/1/1/HEARTBEAT"
    topics = [ODOM, RecordedTopic(key, key, True, Schema("", "", b""), "")]
    adapters = [MavlinkAdapter("minimal")]
    for text, expected in (
        ("HEARTBEAT", "mavlink_raw/*/*/*/HEARTBEAT"),
        ("1/*/HEARTBEAT", "mavlink_raw/*/1/*/HEARTBEAT"),
        ("255/*/HEARTBEAT", "255/*/HEARTBEAT"),
        ("HEARTBEET", "HEARTBEET"),
    ):
        assert in_full(text, topics, lambda: adapters) == expected
    for text in ("/robot1/odom", "mavlink_raw/**", key):
        assert in_full(text, topics, lambda: pytest.fail("nobody needs to be asked")) == text


@pytest.mark.parametrize(
    ("remap", "expected"),
    [
        ("/robot1/odom:=/x", "/x"),
        ("robot1/odom:=x", "x"),
        ("0/robot1/odom/nav::O_/H:=/y", "/y"),
        ("/robot1/**:=/robot2/**", "/robot2/odom"),
        ("/**:=/all/**", "/all/robot1/odom"),
        ("/robot1/odom/**:=/z/**", "/z"),
        ("/robot:=/x", None),
        ("/rob/**:=/x/**", None),
    ],
)
def test_new_names(remap, expected):
    assert renamed(ODOM, parse_remaps([remap])) == expected


@pytest.mark.parametrize("text", ["", "a", "a:=", ":=b", "a/**:=b", "a:=b/**", "/:=b"])
def test_what_renames_nothing(text):
    with pytest.raises(ConfigError, match="does not say what to rename"):
        parse_remaps([text])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0", 5),
        ("1.5", 1_500_000_005),
        ("0.7", 700_000_005),
        ("1e2", 100 * 10**9 + 5),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("1970-01-01T00:00:01", 10**9),
        ("1970-01-01T01:00:00.000001+01:00", 1000),
        ("2026-11-21", 1_795_219_200 * 10**9),
    ],
)
def test_times(text, expected):
    assert parse_time(text, 5, where="--end") == expected


@settings(deadline=None)
@given(st.datetimes(datetime(1980, 1, 1), datetime(2200, 1, 1)), st.integers(-14, 14))
def test_dates_are_exact(moment, hours):
    zone = timezone(timedelta(hours=hours))
    exact = (moment.replace(tzinfo=zone) - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
    assert parse_time(moment.replace(tzinfo=zone).isoformat(), 7, where="--end") == exact


@pytest.mark.parametrize("text", ["", "x", "-1", "nan", "inf", "1e12", "2026-13-01", "5 s"])
def test_what_is_no_time(text):
    with pytest.raises(ConfigError, match="no time") as caught:
        parse_time(text, 5, where="--end")
    assert caught.value.where == "--end"
