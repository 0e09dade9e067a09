from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_ros2.qos import RosQos
from riot_bus_ros2.ros2dds import (
    BridgeQos,
    BridgeToken,
    build_bridge_token,
    key_of,
    name_of,
    parse_bridge_token,
    request_attachment,
)
from tests.unit.riot_bus_ros2.ros_names import bridge_qos, bridge_tokens, names, relaxed

KNOWN = {
    "@/3f2a/@ros2_lv/MP/bot1§odom/nav_msgs§msg§Odometry/:1:0:0,10:typehash=RIHS01_ab12;": BridgeToken(
        "3f2a",
        "MP",
        "bot1/odom",
        "nav_msgs/msg/Odometry",
        BridgeQos(reliability=1, durability=0, history=0, depth=10, user_data="typehash=RIHS01_ab12;"),
    ),
    "@/3f2a/@ros2_lv/MS/map/nav_msgs§msg§OccupancyGrid/:::": BridgeToken(
        "3f2a", "MS", "map", "nav_msgs/msg/OccupancyGrid", BridgeQos()
    ),
    "@/3f2a/@ros2_lv/MP/keyed/a_b§msg§C/K::1:1,0": BridgeToken(
        "3f2a", "MP", "keyed", "a_b/msg/C", BridgeQos(keyed=True, durability=1, history=1, depth=0)
    ),
    "@/3f2a/@ros2_lv/SS/add/example_interfaces§srv§AddTwoInts": BridgeToken(
        "3f2a", "SS", "add", "example_interfaces/srv/AddTwoInts"
    ),
    "@/3f2a/@ros2_lv/AC/dock/nav_msgs§action§Dock": BridgeToken("3f2a", "AC", "dock", "nav_msgs/action/Dock"),
}


@pytest.mark.parametrize(("text", "token"), KNOWN.items())
def test_tokens_as_the_bridge_writes_them(text: str, token: BridgeToken) -> None:
    assert parse_bridge_token(text) == token
    assert build_bridge_token(token) == text


@relaxed
@given(bridge_tokens)
def test_what_is_built_is_read(token: BridgeToken) -> None:
    assert parse_bridge_token(build_bridge_token(token)) == token


@pytest.mark.parametrize(
    "text",
    [
        "",
        "@ros2_lv/0/3f/0/0/NN/%/%/n",
        "@/3f/@ros2_lv",
        "@/3f/@ros2_lv/MP/odom",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/::",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/X:::",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/:::1",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/:x::",
        "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/:" + "9" * 5000 + "::",
        "@/3f/@ros2_lv/SS/add/a§srv§B/:::",
        "@/3f/@ros2_lv/XX/add/a§srv§B",
        "@/zid/@ros2_lv/SS/add/a§srv§B",
    ],
)
def test_other_tokens_are_none(text: str) -> None:
    assert parse_bridge_token(text) is None


@relaxed
@given(st.text(st.sampled_from("@/MPSAC§:,0K=;"), max_size=60))
def test_whatever_somebody_announces_is_no_error(text: str) -> None:
    for each in (text, f"@/3f/@ros2_lv/MP/{text}", f"@/3f/@ros2_lv/MP/a/b/{text}"):
        found = parse_bridge_token(each)
        assert found is None or parse_bridge_token(build_bridge_token(found)) == found


@relaxed
@given(names, st.just("/") | names)
def test_names_and_keys(name: str, namespace: str) -> None:
    key = key_of(name, namespace)
    assert name_of(key, namespace) == name
    assert name_of(key) == (name if namespace == "/" else namespace + name)
    assert not key.startswith("/")


def test_keys_of_other_robots_keep_their_namespace() -> None:
    assert name_of("bot2/odom", "/bot1") == "/bot2/odom"
    assert name_of("bot10/odom", "/bot1") == "/bot10/odom"


@relaxed
@given(bridge_qos)
def test_quality_of_service(qos: BridgeQos) -> None:
    assert BridgeQos.parse(qos.token()) == qos
    assert (qos.type_hash is None) == (qos.user_data == "")


@pytest.mark.parametrize(
    "qos",
    [
        RosQos(depth=10),
        RosQos(reliability=2, depth=1),
        RosQos(durability=1, depth=5),
        RosQos(history=2, depth=0),
    ],
)
def test_numbers_of_dds_are_those_of_rmw(qos: RosQos) -> None:
    assert BridgeQos.of(qos).announced == qos
    assert BridgeQos.of(qos, type_hash="RIHS01_ab").type_hash == "RIHS01_ab"


def test_what_a_token_does_not_say_is_the_default_of_dds() -> None:
    assert BridgeQos().announced == RosQos(reliability=1, durability=2, history=1, depth=1)


def test_requests_of_different_clients_differ() -> None:
    one, other = request_attachment(), request_attachment()
    assert len(one) == 20
    assert (one[:3], one[11:]) == (b"rqh", b"\1\0\0\0\0\0\0\0\1") == (other[:3], other[11:])
    assert one != other
