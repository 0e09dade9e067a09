import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.selector import key_matches
from riot_bus_ros2.keys import (
    ACTION_PARTS,
    DataKey,
    action_of,
    action_parts,
    action_type,
    build_data_key,
    dds_type,
    is_topic,
    key_expression,
    name_of_expression,
    parse_data_key,
    ros_type,
)
from tests.unit.riot_bus_ros2.ros_names import data_keys, names, relaxed, type_names

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
KEYS = {
    f"0/chatter/std_msgs::msg::dds_::String_/{HASH}": DataKey(0, "/chatter", "std_msgs/msg/String", HASH),
    f"7/robot1/a/b/odom/nav_msgs::msg::dds_::Odometry_/{HASH}": DataKey(
        7, "/robot1/a/b/odom", "nav_msgs/msg/Odometry", HASH
    ),
    "0/chatter/std_msgs::msg::dds_::String_/TypeHashNotSupported": DataKey(0, "/chatter", "std_msgs/msg/String"),
    f"2/add/example_interfaces::srv::dds_::AddTwoInts_/{HASH}": DataKey(
        2, "/add", "example_interfaces/srv/AddTwoInts", HASH
    ),
    f"0/fib/_action/feedback/a_b::action::dds_::Fib_FeedbackMessage_/{HASH}": DataKey(
        0, "/fib/_action/feedback", "a_b/action/Fib_FeedbackMessage", HASH
    ),
    f"0/pc/sensor_msgs::msg::dds_::PointCloud2_/{HASH}/_buf_cpu": DataKey(
        0, "/pc", "sensor_msgs/msg/PointCloud2", HASH, "_buf_cpu"
    ),
    f"0/pc/sensor_msgs::msg::dds_::PointCloud2_/{HASH}/_buf/0011aabb": DataKey(
        0, "/pc", "sensor_msgs/msg/PointCloud2", HASH, "_buf/0011aabb"
    ),
}


@pytest.mark.parametrize(("text", "key"), KEYS.items())
def test_parse_and_build(text, key):
    assert parse_data_key(text) == key
    assert build_data_key(key) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "demo/odom",
        "0/chatter",
        f"0/std_msgs::msg::dds_::String_/{HASH}",
        f"x/chatter/std_msgs::msg::dds_::String_/{HASH}",
        "0/chatter/std_msgs::msg::dds_::String_/RIHS01",
        f"0/chatter/std_msgs::msg::String/{HASH}",
        f"@ros2_lv/0/chatter/std_msgs::msg::dds_::String_/{HASH}",
        f"0/chatter/std_msgs::msg::dds_::String_/{HASH}/_other",
        f"007/chatter/std_msgs::msg::dds_::String_/{HASH}",
        f"0//chatter/std_msgs::msg::dds_::String_/{HASH}",
        f"0/*/std_msgs::msg::dds_::String_/{HASH}",
        f"0/@x/std_msgs::msg::dds_::String_/{HASH}",
        f"{'9' * 5000}/chatter/std_msgs::msg::dds_::String_/{HASH}",
    ],
)
def test_other_keys_are_none(text):
    assert parse_data_key(text) is None


def test_key_expression_matches_the_topic_in_every_domain():
    expression = key_expression("/chatter")
    assert expression == "*/chatter/$*::dds_::$*/*/**"
    for topic in {key.topic for key in KEYS.values()}:
        matching = [text for text in KEYS if key_matches(key_expression(topic), text)]
        assert matching == [text for text, key in KEYS.items() if key.topic == topic]


def test_key_expression_of_one_domain_and_with_wildcards():
    assert key_expression("/odom", domain=3) == "3/odom/$*::dds_::$*/*/**"
    assert key_expression("/robot/**") == "*/robot/**/$*::dds_::$*/*/**"


@pytest.mark.parametrize("topic", ["odom", "/", "", "//odom", "/odom/", "/a b", "demo/**"])
def test_other_names_have_no_key_expression(topic):
    assert key_expression(topic) is None


@relaxed
@given(data_keys)
def test_what_is_built_is_read(key):
    text = build_data_key(key)
    assert parse_data_key(text) == key
    assert key_matches(key_expression(key.topic), text)
    assert key_matches(key_expression(key.topic, domain=key.domain), text)
    assert is_topic(key.topic)
    assert name_of_expression(key_expression(key.topic)) == key.topic


@relaxed
@given(data_keys, names)
def test_a_name_means_no_other(key, name):
    expressions = [key_expression(each) for each in (name, key.topic + name, name + key.topic)]
    meant = [key_matches(each, build_data_key(key)) for each in expressions]
    assert meant == [name == key.topic, False, False]


@relaxed
@given(data_keys, st.data())
def test_what_is_read_of_damaged_keys_is_built_again(key, data):
    text = build_data_key(key)
    place = data.draw(st.integers(0, len(text)))
    damaged = text[:place] + data.draw(st.text(st.sampled_from("/_:@*0aR"), max_size=3)) + text[place + 1 :]
    found = parse_data_key(damaged)
    assert found is None or build_data_key(found) == damaged


@relaxed
@given(type_names)
def test_types(name):
    assert ros_type(dds_type(name)) == name


@pytest.mark.parametrize("dds", ["", "String_", "std_msgs::msg::String", "a::idl::dds_::B_", "std_msgs::msg::dds_::B"])
def test_other_types(dds):
    assert ros_type(dds) is None
    assert dds_type(dds) == dds


@relaxed
@given(names, type_names)
def test_parts_of_actions(action, type_name):
    parts = action_parts(action, type_name)
    assert [action_of(name) for name in parts] == [(action, part) for part in ACTION_PARTS]
    kinds = [action_type(part, each) for part, each in zip(ACTION_PARTS, parts.values(), strict=True)]
    assert kinds == [type_name, None, type_name, type_name, None]


@pytest.mark.parametrize(
    "name", ["/dock", "/dock/_action", "/dock/_action/other", "/_action/status", "/dock/_action/status/x"]
)
def test_what_belongs_to_no_action(name):
    assert action_of(name) is None


@pytest.mark.parametrize("text", ["/robot/**", "/**", "/*/odom", "/a$*/b"])
def test_expressions_are_called_what_they_were_made_of(text):
    assert name_of_expression(key_expression(text)) == text


@pytest.mark.parametrize("text", ["", "a/**", "3/odom/$*::dds_::$*/*/**", "*/$*::dds_::$*/*/**"])
def test_other_expressions_have_no_name(text):
    assert name_of_expression(text) is None
