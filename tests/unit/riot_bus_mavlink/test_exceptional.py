import math
import struct

import pytest

from riot_bus.inject.dictionary import eligible, load_dictionary
from riot_bus.types.capabilities import suggested_values
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.exceptional import invalid_values
from riot_bus_mavlink.frame import pack_frame
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.units import values_of_unit

ALL = load_dialect()


def kind(name):
    return MavlinkType(ALL.message(name), ALL.enums)


def frame(name, **fields):
    message = ALL.message(name)
    empty = pack_frame(message.id, bytes(message.size), message.crc_extra, version=2, sequence=0, system=1, component=1)
    return kind(name).patch(empty, fields)


def told(name, path, **fields):
    return {entry.value: entry.reason for entry in suggested_values(kind(name), frame(name, **fields), path)}


def test_all_values_fit_their_fields():
    for message in ALL.messages.values():
        one = kind(message.name)
        raw = frame(message.name)
        for leaf in one.leaves(raw, elements=1):
            entries = suggested_values(one, raw, leaf.path)
            assert all(eligible(leaf.type, entry.value) and entry.reason for entry in entries), (message.name, leaf)
            assert len({repr(entry.value) for entry in entries}) == len(entries) <= 90


def test_enums():
    found = told("HEARTBEAT", "system_status")
    assert found[4] == "MAV_STATE_ACTIVE"
    assert found[9] == "above all of MAV_STATE"
    assert found[255] == "far from all of MAV_STATE"
    assert -1 not in found
    gaps = told("HEARTBEAT", "type")
    assert any(reason == "undefined in MAV_TYPE" or reason == "above all of MAV_TYPE" for reason in gaps.values())


def test_flags():
    found = told("HEARTBEAT", "base_mode")
    assert found[0] == "no flag"
    assert found[255] == "all of MAV_MODE_FLAG"
    assert found[128] == "MAV_MODE_FLAG_SAFETY_ARMED alone"
    sensors = told("SYS_STATUS", "onboard_control_sensors_present")
    assert sensors[(1 << 32) - 1]


def test_units():
    found = told("GLOBAL_POSITION_INT", "lat")
    assert found[900_000_000] == "90 deg"
    assert found[905_000_000] == "beyond a pole"
    assert found[1_805_000_000] == "beyond 180 deg"
    assert 3_600_000_000 not in found
    assert told("SYS_STATUS", "load")[1010] == "more than all"
    assert told("SCALED_PRESSURE", "temperature")[-27_400] == "below absolute zero"
    assert told("ATTITUDE", "roll")[math.pi] == "180 deg"
    assert values_of_unit("furlong") == []
    assert values_of_unit("") == []


@pytest.mark.parametrize("unit", ["degE7", "cdeg", "mm", "us", "%", "c%", "cm/s", "mV", "cA", "mAh", "hPa", "rad/s"])
def test_common_units_are_known(unit):
    assert values_of_unit(unit)


def test_markers():
    assert told("GPS_RAW_INT", "eph")[65_535] == "the marker for what is not known"
    assert [entry for entry in told("ODOMETRY", "pose_covariance[0]") if math.isnan(entry)]
    assert told("BATTERY_STATUS", "voltages[3]")[65_535] == "the marker for what is not known"
    assert invalid_values("INT16_MIN") == [-32_768]
    assert invalid_values("UINT16_MIN") == [0]
    assert invalid_values("[1,,3]", 2) == [3]
    assert invalid_values("[1,,3]", 1) == invalid_values("[1,,3]", 7) == invalid_values("MAV_STATE") == []


def test_text():
    found = told("STATUSTEXT", "text")
    assert found["A" * 50] == "fills its array, so that no NUL ends it"


def test_parameters_of_the_command_in_a_message():
    arm = told("COMMAND_LONG", "param2", command=400)
    assert arm[21196.0]
    takeoff = told("COMMAND_INT", "x", command=22)
    assert takeoff[1_805_000_000] == "beyond 180 deg"
    float_takeoff = told("COMMAND_LONG", "param5", command=22)
    assert float_takeoff[180.5] == "beyond 180 deg"
    assert told("COMMAND_LONG", "param5", command=65_000) == {}
    speed = told("MISSION_ITEM_INT", "param1", command=178)
    assert speed[1.0] == "SPEED_TYPE_GROUNDSPEED"


def test_fields_that_are_not_there():
    assert told("HEARTBEAT", "nothing") == {}
    assert told("HEARTBEAT", "header.sequence") == {}
    assert suggested_values(kind("COMMAND_LONG"), b"junk", "param1") == []
    assert suggested_values(None, b"", "x") == ()


@pytest.mark.parametrize(
    ("name", "path", "brittle"),
    [
        ("HEARTBEAT", "header.sequence", True),
        ("HEARTBEAT", "header.system_id", True),
        ("HEARTBEAT", "mavlink_version", True),
        ("HEARTBEAT", "custom_mode", False),
        ("COMMAND_LONG", "target_system", True),
        ("COMMAND_LONG", "param1", False),
        ("ATTITUDE", "time_boot_ms", True),
        ("MISSION_ITEM_INT", "seq", False),
        ("PING", "seq", True),
        ("AUTOPILOT_VERSION", "flight_sw_version", False),
        ("MESSAGE_INTERVAL", "message_id", False),
        ("ODOMETRY", "frame_id", False),
        ("LOG_DATA", "data[0]", False),
    ],
)
def test_brittle_fields(name, path, brittle):
    from riot_bus.types.brittle import why_brittle

    assert bool(why_brittle(path, kind(name))) == brittle


def test_floats_of_commands_are_not_lost_among_bytes():
    raw = frame("COMMAND_LONG", command=400, param1=1.0)
    assert struct.unpack_from("<f", raw, 10) == (1.0,)
    values = load_dictionary().values_for(
        "float32", "t:param1", told=suggested_values(kind("COMMAND_LONG"), raw, "param1")
    )
    assert any(math.isnan(entry.value) for entry in values)
