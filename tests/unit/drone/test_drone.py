import math
import re
import tomllib
from pathlib import Path

import pytest
from drone import advisor, ros
from drone.autopilot import SYSTEM, Autopilot
from drone.route import ROUTE
from drone.station import Station
from drone.telemetry import STREAMS
from drone.vehicle import Mode, Place, Vehicle
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from riot_bus.types.registry import TypeRegistry, load_adapters
from tests.tiers import scaled

ME = 255, 190
DRONE = Path(__file__).parents[3] / "examples" / "mavlink"


def sent(message, source=ME):
    """A message as it comes over a link."""
    codec = mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
    return mavlink.MAVLink(None).parse_buffer(message.pack(codec))[0]


def ask(autopilot, message):
    return [sent(answer, (1, 1)) for answer in autopilot.answer(sent(message))]


def command(number, *values):
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *values, *[0.0] * (7 - len(values)))


def flown(autopilot, seconds):
    """What it sends by itself."""
    return [message for _ in range(round(seconds / 0.02)) for message in autopilot.tick()]


def test_streams_come_at_their_rates_and_can_be_packed():
    messages = flown(Autopilot(1), 10)
    names = [sent(message, (1, 1)).get_type() for message in messages]
    for stream, rate in STREAMS.items():
        assert names.count(stream.__name__.upper()) == pytest.approx(10 * rate, abs=1)


def test_parameters_by_name_by_number_and_all():
    autopilot = Autopilot(1)
    everything = ask(autopilot, mavlink.MAVLink_param_request_list_message(1, 1))
    assert [each.param_index for each in everything] == list(range(everything[0].param_count))
    (one,) = ask(autopilot, mavlink.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1))
    assert (one.param_id, one.param_value) == ("RTL_ALT", 1500)
    (again,) = ask(autopilot, mavlink.MAVLink_param_request_read_message(1, 1, b"", one.param_index))
    assert again.param_id == "RTL_ALT"
    (changed,) = ask(autopilot, mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 2000.4, one.param_type))
    assert changed.param_value == 2000
    assert ask(autopilot, mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", math.nan, 9))[0].param_value == 2000
    assert ask(autopilot, mavlink.MAVLink_param_request_read_message(1, 1, b"NONE", -1)) == []


def test_station_and_autopilot_fly_the_route_together():
    autopilot, station, told = Autopilot(1), Station(fly=True), []
    reached = set()
    for step in range(6000):
        now = step * 0.02
        to_ground, to_air = list(autopilot.tick()), list(station.tick(now))
        while to_ground or to_air:
            to_ground += [answer for message in to_air for answer in autopilot.answer(sent(message))]
            to_air = []
            for message in to_ground:
                if message.get_type() == "MISSION_ITEM_REACHED":
                    reached.add(message.seq)
                to_air += station.hear(sent(message, (1, 1)), now)
            to_ground = []
        told.append(station.show(now))
        if autopilot.vehicle.time > 60 and not autopilot.vehicle.armed:
            break
    assert reached == {1, 2, 3, 4}
    assert len(station.parameters) == station.count
    assert station.uploaded
    assert not station.armed
    assert any(line and "armed" in line for line in told)


def test_uploads_are_asked_for_again_and_given_up():
    autopilot = Autopilot(1)
    (request,) = ask(autopilot, mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    assert (request.get_type(), request.seq) == ("MISSION_REQUEST", 0)
    sent_by_itself = [each for each in flown(autopilot, 10) if each.get_type().startswith("MISSION_")]
    later = [each for each in sent_by_itself if each.get_type() != "MISSION_CURRENT"]
    assert [each.get_type() for each in later] == ["MISSION_REQUEST"] * 4 + ["MISSION_ACK"]
    assert later[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    (ack,) = ask(autopilot, mavlink.MAVLink_mission_count_message(1, 1, 60000, 0))
    assert ack.type == mavlink.MAV_MISSION_NO_SPACE


def test_commands_that_cannot_be_carried_out_are_refused():
    autopilot = Autopilot(1)

    def result(number, *values):
        return next(each.result for each in ask(autopilot, command(number, *values)) if hasattr(each, "result"))

    accepted, denied = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
    assert result(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == denied
    assert result(mavlink.MAV_CMD_DO_SET_MODE, 1, 77) == denied
    assert result(mavlink.MAV_CMD_DO_SET_MODE, 1, math.nan) == denied
    assert result(mavlink.MAV_CMD_DO_SET_MODE, 1, Mode.GUIDED) == accepted
    assert result(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == accepted
    for height, expected in ((math.nan, denied), (1e9, denied), (5, accepted)):
        assert result(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height) == expected
    flown(autopilot, 5)
    assert autopilot.vehicle.place.height == pytest.approx(5, abs=0.6)
    assert result(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert result(mavlink.MAV_CMD_DO_PARACHUTE) == mavlink.MAV_RESULT_UNSUPPORTED
    assert result(mavlink.MAV_CMD_NAV_LAND) == accepted
    flown(autopilot, 10)
    assert not autopilot.vehicle.armed


def test_it_flies_by_itself_if_it_is_told_to():
    autopilot = Autopilot(1, fly=True)
    flown(autopilot, 10)
    assert autopilot.vehicle.armed
    assert autopilot.vehicle.mode is Mode.AUTO
    assert autopilot.vehicle.place.height > 10


MESSAGES = ("PARAM_SET", "MISSION_ITEM_INT", "MISSION_COUNT", "COMMAND_LONG", "COMMAND_INT", "SET_MODE", "MISSION_ITEM")


@settings(max_examples=scaled(200), deadline=None)
@given(st.lists(st.tuples(st.sampled_from(MESSAGES), st.binary(min_size=64, max_size=64)), max_size=20))
def test_whatever_is_asked_it_goes_on(asked):
    autopilot = Autopilot(1, fly=True)
    kinds = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}
    for name, data in asked:
        kind = kinds[name]
        values = kind.unpacker.unpack(data[: kind.unpacker.size])
        fields = dict(zip(kind.ordered_fieldnames, values, strict=True))
        message = kind(**{field: fields[field] for field in kind.fieldnames})
        message.pack(mavlink.MAVLink(None, srcSystem=255))
        if hasattr(message, "target_system"):
            message.target_system = SYSTEM
        for answer in [*autopilot.answer(message), *flown(autopilot, 0.1)]:
            answer.pack(mavlink.MAVLink(None, srcSystem=1))


def test_a_vehicle_goes_where_it_is_sent():
    vehicle = Vehicle(armed=True, mode=Mode.GUIDED)
    vehicle.target = Place(vehicle.home.latitude + 0.0003, vehicle.home.longitude - 0.0003, 12)
    for _ in range(1000):
        vehicle.step(0.02)
    assert vehicle.metres_to(vehicle.target) < 1
    assert vehicle.place.height == pytest.approx(12, abs=0.6)
    assert vehicle.battery < 1
    vehicle.enter(Mode.RTL)
    for _ in range(3000):
        vehicle.step(0.02)
    assert not vehicle.flying
    assert not vehicle.armed
    assert vehicle.metres_to(vehicle.home) < 1.5


def test_ros_messages_are_what_riot_reads():
    registry = TypeRegistry(load_adapters(["ros2"]))
    payload = ros.fix(12.5, 47.4, 8.5, 488.0)
    kind = registry.type_of(ros.FIX, payload=payload)
    assert kind is not None
    read = {leaf.path: leaf.value for leaf in kind.leaves(payload)}
    assert (read["header.stamp.sec"], read["header.stamp.nanosec"]) == (12, 500_000_000)
    assert (read["latitude"], read["longitude"], read["altitude"]) == (47.4, 8.5, 488.0)
    assert (read["header.frame_id"], read["status.service"]) == ("gps", 1)
    assert ros.read_fix(payload) == (47.4, 8.5, 488.0)
    with pytest.raises(ValueError, match="no fix"):
        ros.read_fix(payload[:-1])
    payload = ros.number(1.5)
    kind = registry.type_of(ros.CLEARANCE, payload=payload)
    assert kind is not None
    assert kind.read(payload, "data") == 1.5


def test_the_advisor_knows_one_tile():
    assert 466 <= advisor.ground(47.4, 8.54) <= 494
    assert advisor.ground(-90, -180) == advisor.TERRAIN[0][0]
    with pytest.raises(IndexError):
        advisor.ground(47.431, 8.54)


def test_the_route_and_the_riot_toml_are_whole():
    assert ROUTE[0][1:] == (0.0, 0.0, 0.0)
    text = (DRONE / "riot.toml").read_text()
    assert set(tomllib.loads(text)["components"]) == {"autopilot", "station", "relay", "advisor"}
    streams = {stream.__name__.upper() for stream in STREAMS} | {"STATUSTEXT", "PARAM_VALUE"}
    assert set(re.findall(r"air/1/1/(\w+)", text)) <= streams
