"""Both adapters for ROS 2 hold what adapters promise."""

from typing import ClassVar

import pytest

from riot_bus.types.capabilities import (
    AnnouncesServers,
    DiscoversTypes,
    HasServices,
    ListsTypes,
    ParsesTokens,
    PublishesAs,
    ReadsMetadata,
    ReadsTypesFromKeys,
    SetsParameters,
)
from riot_bus.types.model import TopicName
from riot_bus_testkit.adapters import AdapterConformance
from tests.bags import STRING_KEY

pytest.importorskip("rosbags")

from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.ros2dds_adapter import Ros2DdsAdapter

ADD = "example_interfaces::srv::dds_::AddTwoInts_"


class TestRos2(AdapterConformance):
    adapter = Ros2Adapter()
    keys: ClassVar = {
        f"0/robot/chatter/{STRING_KEY}": TopicName("/robot/chatter", "std_msgs/msg/String"),
        "7/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported": TopicName("/odom", "nav_msgs/msg/Odometry"),
        f"0/x/my_msgs::msg::dds_::Odd_/RIHS01_{'0' * 64}": TopicName("/x", "my_msgs/msg/Odd"),
    }
    types = ("std_msgs/msg/String", "nav_msgs/msg/Odometry", "example_interfaces/srv/AddTwoInts_Request")
    capabilities = (
        ListsTypes,
        ReadsTypesFromKeys,
        DiscoversTypes,
        ParsesTokens,
        HasServices,
        AnnouncesServers,
        ReadsMetadata,
        PublishesAs,
        SetsParameters,
    )
    foreign = ("", "a/b", "mavlink_raw/gcs/255/190/HEARTBEAT")
    tokens = (
        "@ros2_lv/0/aa/0/0/NN/%/%/talker",
        f"@ros2_lv/0/aa/0/1/MP/%/%/talker/%robot%chatter/{STRING_KEY}/::,5:,:,:,,",
        f"@ros2_lv/0/aa/0/2/SS/%/%/server/%add/{ADD}/RIHS01_df/::,:,:,:,,",
    )


class TestRos2Dds(AdapterConformance):
    adapter = Ros2DdsAdapter()
    keys: ClassVar = {"robot/chatter": TopicName("/robot/chatter"), "odom": TopicName("/odom")}
    types = TestRos2.types
    capabilities = TestRos2.capabilities
    foreign = ("", "a b", f"0/chatter/{STRING_KEY}")
    tokens = (
        "@/3f/@ros2_lv/MP/heard/nav_msgs§msg§Odometry/:1:0:0,10:typehash=RIHS01_ab;",
        "@/3f/@ros2_lv/AS/dock/nav_msgs§action§Dock",
        "@/3f/@ros2_lv/SS/add/example_interfaces§srv§AddTwoInts",
    )
