from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.keys import build_data_key
from riot_bus_ros2.qos import RosQos, parse_offered
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token, details_of, parse_token
from tests.unit.riot_bus_ros2.ros_names import endpoints, nodes, relaxed

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TALKER = Node(0, "3f2a", 0, "/talker")
ADD_TWO_INTS = "example_interfaces::srv::dds_::AddTwoInts_"
CHATTER = NodeEndpoint(TALKER, 11, "MP", "/chatter", "std_msgs/msg/String", HASH, RosQos(depth=10))
KNOWN: dict[str, Node | NodeEndpoint] = {
    "@ros2_lv/0/3f2a/0/0/NN/%/%/talker": TALKER,
    f"@ros2_lv/0/3f2a/0/11/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,": CHATTER,
    "@ros2_lv/7/ab/2/3/MS/%secure%enclave/%robot1%nav/planner/%robot1%odom/nav_msgs::msg::dds_::Odometry_"
    "/TypeHashNotSupported/2:1:2,1:1,2:3,4:3,5,6": NodeEndpoint(
        Node(7, "ab", 2, "/robot1/nav/planner", "/secure/enclave"),
        3,
        "MS",
        "/robot1/odom",
        "nav_msgs/msg/Odometry",
        None,
        RosQos(2, 1, 2, 1, (1, 2), (3, 4), 3, (5, 6)),
    ),
    f"rb/unit/@ros2_lv/0/3f2a/0/1/MS/%/%/eye/%points/sensor_msgs::msg::dds_::PointCloud2_/{HASH}"
    "/2::,5:,:,:,,/cpu:1;cuda:2": NodeEndpoint(
        Node(0, "3f2a", 0, "/eye", prefix="rb/unit"),
        1,
        "MS",
        "/points",
        "sensor_msgs/msg/PointCloud2",
        HASH,
        RosQos(reliability=2, depth=5),
        "cpu:1;cuda:2",
    ),
    f"@ros2_lv/2/3f2a/0/4/SS/%/%/adder/%add/{ADD_TWO_INTS}/{HASH}/::,10:,:,:,,": NodeEndpoint(
        Node(2, "3f2a", 0, "/adder"),
        4,
        "SS",
        "/add",
        "example_interfaces/srv/AddTwoInts",
        HASH,
        RosQos(depth=10),
    ),
}


@pytest.mark.parametrize(("text", "expected"), KNOWN.items())
def test_tokens_as_rmw_zenoh_writes_them(text: str, expected: Node | NodeEndpoint) -> None:
    assert parse_token(text) == expected
    assert build_token(expected) == text


@relaxed
@given(nodes | endpoints)
def test_what_is_built_is_read(of: Node | NodeEndpoint) -> None:
    text = build_token(of)
    assert parse_token(text) == of
    assert len(gid_of(text)) == 16


@relaxed
@given(endpoints)
def test_the_key_is_that_of_the_messages(of: NodeEndpoint) -> None:
    prefix = f"{of.node.prefix}/" if of.node.prefix else ""
    assert of.key == prefix + build_data_key(of.data_key)


@relaxed
@given(endpoints, st.data())
def test_what_is_read_of_damaged_tokens_is_built_again(of: NodeEndpoint, data: st.DataObject) -> None:
    text = build_token(of)
    place = data.draw(st.integers(0, len(text)))
    damaged = text[:place] + data.draw(st.text(st.sampled_from("/%@:0aX,"), max_size=3)) + text[place + 1 :]
    found = parse_token(damaged)
    assert found is None or parse_token(build_token(found)) == found


@relaxed
@given(st.text(st.sampled_from("@ros2_lv/MPNS%0a:,"), max_size=80))
def test_whatever_somebody_announces_is_no_error(text: str) -> None:
    parse_token(f"@ros2_lv/0/a/0/0/{text}")
    parse_token(text)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "@ros2_lv",
        "@ros2_lv/0/3f/0/0/XX/%/%/n",
        "@ros2_lv/0/3f/0/0/MP/%/%/n",
        "@ros2_lv/0/3f/0/0/MP/%/%/n/%t/y/h",
        "@ros2_lv/x/3f/0/0/NN/%/%/n",
        "@ros2_lv/0/zid/0/0/NN/%/%/n",
        "@ros2_lv/0/3f/0/0/NN//%/n",
        f"@ros2_lv/{'9' * 5000}/3f/0/0/NN/%/%/n",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/:::",
    ],
)
def test_other_tokens_are_none(text: str) -> None:
    assert parse_token(text) is None


def test_types_that_are_none_of_ros_keep_their_names() -> None:
    text = "@ros2_lv/0/3f/0/1/MP/%/%/n/%t/some::Type/any_hash/::,:,:,:,,"
    found = parse_token(text)
    assert isinstance(found, NodeEndpoint)
    assert (found.type_name, found.type_hash, found.key) == ("some::Type", "any_hash", "0/t/some::Type/any_hash")
    assert build_token(found) == text


STRING = "std_msgs::msg::dds_::String_"
CHATTER_KEY = f"0/robot/chatter/{STRING}/RIHS01_df"


def profile_of(text: str) -> str:
    return RosQos.parse(text).profile()


def publisher_token(qos: str, *, kind: str = "MP", topic: str = "%robot%chatter", domain: int = 0) -> str:
    return f"@ros2_lv/{domain}/aa/0/1/{kind}/%/%/talker/{topic}/{STRING}/RIHS01_df/{qos}"


def test_a_profile_is_that_of_the_publisher_token() -> None:
    text = profile_of("2:1:2,7:1,5:,:2,3,4")
    assert text.startswith("- history: 2\n  depth: 7\n  reliability: 2\n  durability: 1\n")
    assert "  deadline:\n    sec: 1\n    nsec: 5\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n" in text
    assert "  liveliness: 2\n  liveliness_lease_duration:\n    sec: 3\n    nsec: 4\n" in text
    usual = parse_offered(profile_of("::,:,:,:,,"))
    assert (usual.reliable, usual.latched, usual.depth) == (True, False, 42)
    for odd in ("", "x:y:z", ":::::::::", "9" * 50, "-1:,"):
        assert parse_offered(profile_of(odd)).depth == 42


def test_all_publishers_of_a_topic_are_told() -> None:
    tokens = [
        publisher_token("::,5:,:,:,,"),
        publisher_token("2:1:,1:,:,:,,"),
        publisher_token("::,9:,:,:,,", kind="MS"),
        publisher_token("::,9:,:,:,,", topic="%other"),
        publisher_token("::,9:,:,:,,", domain=1),
        "@ros2_lv/0/aa/0/0/NN/%/%/talker",
        "nonsense",
    ]
    text = details_of(CHATTER_KEY, tokens)["offered_qos_profiles"]
    assert text.count("- history:") == 2
    assert "depth: 5" in text
    assert "depth: 1\n" in text
    assert "depth: 9" not in text
    assert details_of(CHATTER_KEY, []) == details_of("a/b", tokens) == {}
