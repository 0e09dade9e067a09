"""The adapter for MAVLink holds what adapters promise."""

from typing import ClassVar

import pytest

from riot_bus.types.capabilities import ConvertsFiles, ListsTypes, SetsParameters, TakesFiles
from riot_bus.types.model import TopicName
from riot_bus_testkit.adapters import AdapterConformance

pytest.importorskip("pymavlink")
pytest.importorskip("fastcrc")

from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.frame import pack_frame
from riot_bus_mavlink.tlog import tlog_record

HEARTBEAT = "mavlink_raw/gcs/255/190/HEARTBEAT"


def frame(number):
    return pack_frame(0, bytes(range(1, 10)), 50, version=2, sequence=number, system=255, component=190)


class TestMavlink(AdapterConformance):
    adapter = MavlinkAdapter()
    keys: ClassVar = {
        HEARTBEAT: TopicName(HEARTBEAT, "mavlink/HEARTBEAT"),
        "mavlink_raw/gcs/1/1/ATTITUDE": TopicName("mavlink_raw/gcs/1/1/ATTITUDE", "mavlink/ATTITUDE"),
    }
    types = ("mavlink/HEARTBEAT", "mavlink/COMMAND_LONG")
    capabilities = (TakesFiles, ListsTypes, ConvertsFiles, SetsParameters)
    foreign = ("", "a/b", "0/chatter/std_msgs::msg::dds_::String_/x")
    archive = b"".join(tlog_record(10**18 + number, frame(number)) for number in range(3))
