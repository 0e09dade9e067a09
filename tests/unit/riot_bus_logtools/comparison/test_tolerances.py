from __future__ import annotations

import math
from pathlib import Path

import pytest

from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.selector import key_matches
from riot_bus_logtools.comparison.tolerances import (
    EXACT,
    IGNORED,
    TIME,
    Tolerance,
    tolerances_of,
)


def of(topic: str, *texts: str):
    return tolerances_of(texts).of_topic(lambda text: key_matches(text, topic))


@pytest.mark.parametrize(
    ("tolerance", "a", "b", "allowed"),
    [
        (EXACT, 1, 1.0, True),
        (EXACT, 1.0, 1.0000001, False),
        (EXACT, math.nan, math.nan, True),
        (Tolerance(0.1), 1.0, 1.1 - 1e-12, True),
        (Tolerance(0.1), 1.0, 1.2, False),
        (Tolerance(0.1), 1.0, math.nan, False),
        (Tolerance(0.1), math.inf, math.inf, True),
        (Tolerance(0.1, relative=0.5), math.inf, -math.inf, False),
        (Tolerance(relative=0.01), 1e300, 1e300, True),
        (Tolerance(relative=0.01), 100.0, 101.0, True),
        (Tolerance(relative=0.01), -100.0, -102.0, False),
        (Tolerance(relative=0.01), 0.0, 1e-9, False),
        (Tolerance(5), 1 << 63, (1 << 63) + 5, True),
    ],
)
def test_how_far_numbers_may_be_apart(tolerance, a, b, allowed):
    assert tolerance.allows(a, b) is tolerance.allows(b, a) is allowed


def test_the_last_one_that_names_a_field_counts():
    found = of("robot/odom", "robot/*:pose.*=0.5", "robot/odom:pose.x=1%", "imu:pose.x=9")
    assert found.of_field("pose.x") == Tolerance(relative=0.01)
    assert found.of_field("pose.y") == Tolerance(0.5)
    assert found.of_field("twist.x") == EXACT
    assert of("robot/odom", "robot/odom:pose.x=1%", "**:*=ignore").of_field("pose.x") == IGNORED


def test_elements_of_arrays():
    found = of("scan", "scan:ranges[*]=0.1", "scan:ranges[3]=ignore", "scan:len(ranges)=2")
    assert found.of_field("ranges[12]") == Tolerance(0.1)
    assert found.of_field("ranges[3]") == IGNORED
    assert found.of_field("len(ranges)") == Tolerance(2)


def test_times_are_left_apart_unless_they_are_asked_for():
    assert of("a").of_field("header.stamp.sec") == of("a").of_field("time_usec") == TIME
    assert of("a").of_field("header.frame_id") == of("a").of_field("seq") == EXACT
    assert of("a", "a:header.stamp.*=0").of_field("header.stamp.sec") == EXACT


def test_some_types_are_times_as_a_whole():
    clock = TypeRegistry(load_adapters()).type_named("rosgraph_msgs/msg/Clock")
    assert of("a").of_field("clock.sec", clock) == TIME
    assert of("a").of_field("clock.sec") == EXACT


def test_messages_of_a_topic_and_whole_topics():
    assert of("a", "a=3").messages == Tolerance(3)
    assert of("a", "a=3").of_field("x") == EXACT
    assert of("a", "a=ignore").messages.leave
    assert of("a", "b=3", "a:x=1").messages == EXACT


def test_which_name_no_topic():
    found = tolerances_of(["a:x=1", "b=2"])
    assert found.unused(lambda text: text == "a") == ["b"]


def test_ros_keys_have_colons_too():
    key = "0/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_3c"
    assert of(key, f"{key}:pose.x=1").of_field("pose.x") == Tolerance(1)


@pytest.mark.parametrize(
    "text", ["a:x", "a:x=", "a:x=-1", "a:x=nan", "a:x=inf", "a:x=five", "a:x=5%%", ":x=1", "a:=1", "=1", "a:x=-1%"]
)
def test_what_says_no_tolerance(text):
    with pytest.raises(ConfigError, match="tolerance") as error:
        tolerances_of([text])
    assert error.value.where == "--tolerance"
    assert "1%" in str(error.value.hint)


def test_a_file_and_options_together(tmp_path: Path):
    file = tmp_path / "t.toml"
    file.write_text('[tolerances]\n"a:x" = 0.5\n"a:y" = "2%"\n"a:z" = "ignore"\n"a" = 4\n', encoding="utf-8")
    found = tolerances_of(["a:x=0.1"], [file]).of_topic(lambda text: text == "a")
    assert found.of_field("x") == Tolerance(0.1)
    assert found.of_field("y") == Tolerance(relative=0.02)
    assert found.of_field("z") == IGNORED
    assert found.messages == Tolerance(4)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[tolerances", "not a TOML file"),
        ("[fields]\n", "something else"),
        ("tolerances = 3\n", "something else"),
        ("[tolerances]\na = true\n", "no tolerance"),
        ("[tolerances]\na.b = 1\n", "no tolerance"),
        ("[tolerances]\na = [1]\n", "no tolerance"),
        ("[tolerances]\na = 1\n[more]\n", "something else"),
    ],
)
def test_files_that_are_none(tmp_path: Path, text: str, problem: str):
    file = tmp_path / "t.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=problem) as error:
        tolerances_of((), [file])
    assert error.value.where == str(file)


def test_a_file_that_is_not_there_or_no_text(tmp_path: Path):
    with pytest.raises(ConfigError, match="cannot read"):
        tolerances_of((), [tmp_path / "none.toml"])
    (tmp_path / "t.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a TOML file"):
        tolerances_of((), [tmp_path / "t.toml"])
