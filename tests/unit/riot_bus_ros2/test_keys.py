import pytest

from riot_bus.selector import key_matches
from riot_bus_ros2.keys import DataKey, build_data_key, key_expression, parse_data_key

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
        f"{'9' * 5000}/chatter/std_msgs::msg::dds_::String_/{HASH}",
    ],
)
def test_other_keys_are_none(text):
    assert parse_data_key(text) is None


def test_key_expression_matches_the_topic_in_every_domain():
    expression = key_expression("/chatter")
    assert expression == "*/chatter/*/*"
    matching = [text for text in KEYS if key_matches(expression, text)]
    assert matching == [text for text, key in KEYS.items() if key.topic == "/chatter"]


def test_key_expression_of_one_domain_and_with_wildcards():
    assert key_expression("/odom", domain=3) == "3/odom/*/*"
    assert key_expression("/robot/**") == "*/robot/**/*/*"


@pytest.mark.parametrize("topic", ["odom", "/", "", "//odom", "/odom/", "/a b", "demo/**"])
def test_other_names_have_no_key_expression(topic):
    assert key_expression(topic) is None
