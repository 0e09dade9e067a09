"""Names and units beside a rule, by the definitions of MAVLink and ROS 2."""

from __future__ import annotations

import pytest

from riot_bus.chain.base.logs import NamedField
from riot_bus.chain.unit.legend import legend_of
from riot_bus.findings.records import ProportionRecord, RuleRecord
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.types.json_type import JsonType
from riot_bus.types.model import Leaf, MessageType
from riot_bus.vocabulary.trial import Scalar
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_ros2.adapter import Ros2Adapter


def named(name: str, kind: MessageType, type_: str, value: Scalar = 0) -> NamedField:
    topic, _, path = name.partition(":")
    return NamedField(name, topic, 0, Leaf(path, type_, value), None, kind, b"")


def rule(*literals: Literal) -> Rule:
    return Rule((literals,))


def raw(name: str, operator: str, value: Scalar | tuple[Scalar, ...]) -> Literal:
    return Literal(Feature("raw", (name,)), operator, value)


@pytest.fixture
def fields() -> dict[str, NamedField]:
    mavlink, ros2 = MavlinkAdapter("common"), Ros2Adapter()
    command, heartbeat = mavlink.type_named("mavlink/COMMAND_LONG"), mavlink.type_named("mavlink/HEARTBEAT")
    fix, odometry = ros2.type_named("sensor_msgs/msg/NavSatFix"), ros2.type_named("nav_msgs/msg/Odometry")
    assert None not in (command, heartbeat, fix, odometry)
    found = [
        named("c:command", command, "uint16"),
        named("h:base_mode", heartbeat, "uint8"),
        named("/fix:status.status", fix, "int8"),
        named("/odom:twist.twist.linear.x", odometry, "float64", 0.0),
        named("/odom:pose.covariance[3]", odometry, "float64", 0.0),
        named("j:x", JsonType(), "int64"),
    ]
    return {each.name: each for each in found}


def test_values_have_the_names_of_the_definition_and_fields_their_units(fields: dict[str, NamedField]) -> None:
    found = rule(
        raw("c:command", "in", (400, 401, 7_777)),
        raw("/fix:status.status", "<=", -1.0),
        raw("/odom:twist.twist.linear.x", ">", 2.5),
        raw("/odom:twist.twist.linear.x", "<", 3.5),
        Literal(Feature("bits", ("h:base_mode",), 128), "!=", 0),
        raw("j:x", "==", 4),
    )
    assert legend_of(found, fields, ["c", "h", "/fix", "/odom", "j"]) == (
        "400 of c:command is MAV_CMD_COMPONENT_ARM_DISARM",
        "401 of c:command is MAV_CMD_RUN_PREARM_CHECKS",
        "-1 of /fix:status.status is STATUS_NO_FIX",
        "/odom:twist.twist.linear.x is in m/s",
        "128 of h:base_mode is MAV_MODE_FLAG_SAFETY_ARMED",
    )


def test_limits_of_sums_elements_and_what_nobody_defines_have_no_names(fields: dict[str, NamedField]) -> None:
    found = rule(
        Literal(Feature("add", ("c:command", "h:base_mode")), "==", 400),
        raw("/odom:pose.covariance[3]", ">", 1.0),
        raw("c:command", ">=", 400.5),
        raw("gone:x", "==", 1),
    )
    assert legend_of(found, fields, ["c", "h", "/odom"]) == ()


def test_it_stands_beside_the_rule() -> None:
    one = ProportionRecord(value=1.0, low=0.9, high=1.0, count=20, total=20)
    record = RuleRecord(
        text="c:command == 400",
        rule={},
        precision=one,
        recall=one,
        balanced_accuracy=1.0,
        checks=40,
        scale={},
        legend=("400 of c:command is ARM",),
    )
    assert record.summary.startswith(
        "fails when c:command == 400, where 400 of c:command is ARM (balanced accuracy 1.000"
    )
