from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.types.capabilities import Announcement
from riot_bus_ros2.announcing import announcement_of
from riot_bus_ros2.keys import action_parts
from riot_bus_ros2.ros2dds import BridgeToken, build_bridge_token
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token
from tests.unit.riot_bus_ros2.ros_names import bridge_tokens, endpoints, names, relaxed

NODE = Node(7, "3f2a", 0, "/robot1/nav")


def test_nodes_and_endpoints_of_rmw_zenoh() -> None:
    entity = "@ros2_lv/7/3f2a/0/11/MS/%/%robot1/nav/%robot1%odom/nav_msgs::msg::dds_::Odometry_/RIHS01_ab/::,10:,:,:,,"
    assert announcement_of(entity) == Announcement(
        zid="3f2a",
        role="subscribes",
        key="7/robot1/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_ab",
        node="/robot1/nav",
        topic="/robot1/odom",
        type_name="nav_msgs/msg/Odometry",
        source="ros2 token",
    )
    assert announcement_of(build_token(NODE)) == Announcement("3f2a", None, "", "/robot1/nav", "", "", "ros2 token")
    spaced = announcement_of("rb/x/" + entity)
    assert spaced is not None
    assert spaced.key.startswith("rb/x/7/robot1/odom/")
    for kind, role in (("MP", "publishes"), ("SS", "serves"), ("SC", "calls")):
        other = announcement_of(entity.replace("/MS/", f"/{kind}/") + "/backend:metadata")
        assert other is not None
        assert other.role == role


def test_bridges() -> None:
    token = "@/3f/@ros2_lv/MP/bot1§odom/nav_msgs§msg§Odometry/:::"
    expected = Announcement("3f", "publishes", "bot1/odom", "", "/bot1/odom", "nav_msgs/msg/Odometry", "bridge token")
    assert announcement_of(token) == expected
    inside = announcement_of(token, namespace="/bot1")
    assert inside is not None
    assert inside.topic == "/odom"


def test_actions_are_told_by_each_of_their_parts() -> None:
    for number, (name, type_name) in enumerate(action_parts("/dock", "nav_msgs/action/Dock").items()):
        token = build_token(
            NodeEndpoint(NODE, number, "MP" if name.endswith(("/feedback", "/status")) else "SS", name, type_name)
        )
        found = announcement_of(token)
        assert found is not None
        assert (found.topic, found.type_name, found.action) == (name, type_name, "/dock")
        assert found.action_type == ("nav_msgs/action/Dock" if type_name.startswith("nav_msgs") else "")
    bridged = announcement_of(build_bridge_token(BridgeToken("3f", "AS", "dock", "nav_msgs/action/Dock")))
    assert bridged is not None
    assert (bridged.role, bridged.topic, bridged.action) == ("serves", "/dock", "/dock")
    assert bridged.action_type == bridged.type_name == "nav_msgs/action/Dock"


@relaxed
@given(endpoints | bridge_tokens)
def test_what_is_announced_is_named(of: NodeEndpoint | BridgeToken) -> None:
    if isinstance(of, NodeEndpoint):
        found = announcement_of(build_token(of))
        assert found is not None
        assert (found.key, found.node, found.topic) == (of.key, of.node.name, of.topic)
    else:
        found = announcement_of(build_bridge_token(of))
        assert found is not None
        assert (found.key, found.node, found.topic) == (of.key, "", f"/{of.key}")
    assert found.type_name == of.type_name


@relaxed
@given(names | st.text(max_size=30))
def test_other_tokens_are_none(text: str) -> None:
    assert announcement_of(text) is None
