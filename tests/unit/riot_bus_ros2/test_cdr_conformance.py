"""CDR does what every message type has to do."""

from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore
from riot_bus_testkit.types import TypeConformance

TEXT = """bool flag
float64 number
int16[3] few
int64[] many
string text
string<=9[<=4] texts
Inner[] inner
uint8 last
================================================================================
MSG: pkg/Inner
uint8 a
string b
float32[2] c
"""
MIXED = CdrType("pkg/msg/Mixed", TypeStore(parse_msg(TEXT, "pkg/msg/Mixed")))
CHANGES = {
    "number": 1.5, "few[1]": -2, "len(many)": 3, "many[2]": -5, "text": "hello", "len(texts)": 2, "texts[0]": "é",
    "len(inner)": 2, "inner[0].b": "ab", "inner[1].c[1]": 0.25, "last": 200,
}  # fmt: skip


ODOMETRY = Ros2Adapter().type_named("nav_msgs/msg/Odometry")
HEADS = (b"\0\1\0\0", b"\0\0\0\0")


class TestMixed(TypeConformance):
    kind = MIXED
    payloads = tuple(MIXED.rebuild(head + bytes(100), CHANGES)[:-50] for head in HEADS)


class TestOdometry(TypeConformance):
    kind = ODOMETRY
    payloads = tuple(
        ODOMETRY.rebuild(head + bytes(800), {"header.frame_id": "odom", "pose.covariance[7]": 0.5}) for head in HEADS
    )


PARAMETERS = Ros2Adapter().type_named("rcl_interfaces/srv/SetParameters_Request")
PARAMETER_CHANGES = {
    "len(parameters)": 2, "parameters[1].name": "speed", "len(parameters[1].value.double_array_value)": 3,
    "parameters[1].value.double_array_value[2]": 0.5, "len(parameters[0].value.string_array_value)": 2,
    "parameters[0].value.string_array_value[1]": "fast", "parameters[0].value.bool_value": True,
}  # fmt: skip


class TestParameters(TypeConformance):
    kind = PARAMETERS
    payloads = tuple(PARAMETERS.rebuild(head + bytes(4), PARAMETER_CHANGES) for head in HEADS)
