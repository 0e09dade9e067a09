"""Parameters of what runs: set before each run as rmw_zenoh, zenoh-bridge-ros2dds and MAVLink do."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import PARAMETERS, Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from riot_bus_mavlink.frame import pack_frame

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, os, sys, threading
import zenoh
from riot_bus_ros2.attachment import parse_attachment
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.keys import build_data_key, DataKey
from riot_bus_ros2.ros2dds import BridgeToken, build_bridge_token
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token

ENDPOINT, STYLE, START = sys.argv[1:]
SERVICE = "rcl_interfaces/srv/SetParameters"
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
session = zenoh.open(config)
zid, store, gain = str(session.info.zid()), TypeStore(), float(START)
response = CdrType(SERVICE + "_Response", store)
one_result = response.rebuild(bytes([0, 1]) + bytes(6), {"len(results)": 1})


def take(query):
    global gain
    attachment = query.attachment.to_bytes()
    if STYLE == "rmw":
        parse_attachment(attachment)
    else:
        assert len(attachment) == 20 and attachment[:3] == b"rqh"
    (asked,) = store.decode(query.payload.to_bytes(), SERVICE + "_Request").parameters
    value = asked.value.double_value
    if value == 7:
        os.abort()
    why = "" if (asked.name, asked.value.type) == ("planner.gain", 3) and value <= 10 else "at most 10"
    gain = gain if why else value
    reply = response.rebuild(one_result, {"results[0].successful": not why, "results[0].reason": why})
    query.reply(query.key_expr, reply, attachment=attachment)
    query.drop()


def answer(sample):
    session.put("out", json.dumps({"y": gain * json.loads(sample.payload.to_bytes())["x"], "pid": os.getpid()}))


if STYLE == "rmw":
    server = NodeEndpoint(Node(0, zid, 0, "/planner"), 1, "SS", "/planner/set_parameters", SERVICE, "RIHS01_ab")
    key, token = server.key, build_token(server)
else:
    key = "planner/set_parameters"
    token = build_bridge_token(BridgeToken(zid, "SS", key, SERVICE))
declared = [
    session.declare_subscriber("in", answer),
    session.declare_subscriber("reset", lambda sample: None),
    session.liveliness().declare_token(token),
    session.declare_queryable(key, take, complete=STYLE == "rmw"),
]
threading.Event().wait()
"""
SYSTEM = """
[system]
name = "gains"
segments = ["outside", "inside"]
adapters = ["{adapter}"]
reset = { topic = "{slash}reset" }
types = { "{slash}in" = "json", "{slash}out" = "json" }

[external]
topics = ["{slash}in"]
parameters = { gain = { nominal = 2.0, range = [-9, 20], node = "/planner", name = "planner.gain" } }

[components.planner]
command = ["{python}", "node.py", "{endpoint}", "{style}", "5"]
segment = "inside"
inputs = ["{slash}in"]
outputs = ["{slash}out"]
ready = { timeout = 60 }
"""
LOG = tuple(Message(10**18 + number * 50_000_000, "in", b'{"x": 1}') for number in range(4))


def runs(folder: Path, gains: list[float | None], system: str = SYSTEM, style: str = "rmw") -> list[Outcome]:
    """Return what comes of runs one after the other, each with a gain; None leaves it nominal."""
    adapter, slash = {"rmw": ("ros2", ""), "bridge": ("ros2dds", "/")}[style]  # of bridges, each key is a ROS name
    for word, text in {"{adapter}": adapter, "{slash}": slash, "{style}": style}.items():
        system = system.replace(word, text)
    (folder / "riot.toml").write_text(system)
    (folder / "node.py").write_text(NODE)
    trial = SystemTrial(RunPace(duration=1.0), (f"{slash}out:y", f"{slash}out:pid"))
    cases = [TestCase(LOG, () if each is None else (Injection(PARAMETERS, "gain", each),)) for each in gains]
    with Pool(folder / "riot.toml", 1, keep=folder / "trials") as pool:
        return [pool.execute(trial, case) for case in cases]


def seen(outcome: Outcome, name: str = "y") -> set[object]:
    return {value for text, series in outcome.observed.items() if text.endswith(f":{name}") for value in series.values}


@pytest.mark.parametrize("style", ["rmw", "bridge"])
def test_each_run_of_a_process_that_goes_on_has_its_own_value(tmp_path: Path, style: str) -> None:
    outcomes = runs(tmp_path, [None, 3.0, 11.0, -1, None], style=style)
    assert [one.verdict for one in outcomes] == [Verdict.PASS] * 5, [one.detail for one in outcomes]
    assert [seen(one) for one in outcomes] == [{2.0}, {3.0}, {2.0}, {-1.0}, {2.0}]
    assert len(set[object]().union(*(seen(one, "pid") for one in outcomes))) == 1
    refused = {"gain": "/planner refused 11.0: at most 10"}
    assert [one.statistics.get("refused", {}) for one in outcomes] == [{}, {}, refused, {}, {}]
    assert outcomes[2].detail == "param:gain: /planner refused 11.0: at most 10"


def test_a_node_that_dies_of_a_value_has_failed(tmp_path: Path) -> None:
    outcomes = runs(tmp_path, [7.0, None])
    assert [one.verdict for one in outcomes] == [Verdict.FAIL, Verdict.PASS]
    assert "SIGABRT" in outcomes[0].violations[0].signature


def test_virtual_time_begins_when_the_value_is_set(tmp_path: Path) -> None:
    clock = SYSTEM.replace("reset = { topic", "clock.reset = { topic")
    outcomes = runs(tmp_path, [3.0, None], clock)
    assert [seen(one) for one in outcomes] == [{3.0}, {2.0}], [one.detail for one in outcomes]


def test_a_nominal_value_that_is_refused_and_a_node_that_is_not_there_are_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"/planner refuses the nominal value 12.0: at most 10"):
        runs(tmp_path, [None], SYSTEM.replace("nominal = 2.0", "nominal = 12.0"))
    other = SYSTEM.replace('"/planner"', '"/planer"').replace("timeout = 60", "timeout = 5")
    (outcome,) = runs(tmp_path, [None], other)
    assert outcome.verdict is Verdict.ERROR
    assert "node '/planer' has not announced its service 'set_parameters' within 5 s" in outcome.detail
    assert "'/planner'" in outcome.detail


VEHICLE = """
import struct, sys
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

FLOAT, INTEGER = common.MAV_PARAM_TYPE_REAL32, common.MAV_PARAM_TYPE_INT32
autopilot, values = int(sys.argv[2]), {"GAIN": 5.0, "LEVEL": 5}
link = mavutil.mavlink_connection(sys.argv[1], source_system=1, source_component=1)
cast = autopilot == common.MAV_AUTOPILOT_ARDUPILOTMEGA


def tell(name):
    value = values[name]
    if name == "LEVEL" and not cast:
        (value,) = struct.unpack("<f", struct.pack("<i", value))
    link.mav.param_value_send(name.encode(), value, INTEGER if name == "LEVEL" else FLOAT, 2, 0)


while True:
    message = link.recv_match(blocking=True, timeout=0.1)
    if message is None:
        link.mav.heartbeat_send(common.MAV_TYPE_QUADROTOR, autopilot, 0, 0, common.MAV_STATE_ACTIVE)
    elif message.get_type() == "PARAM_REQUEST_READ" and message.param_id in values:
        tell(message.param_id)
    elif message.get_type() == "PARAM_SET" and message.param_id in values:
        value = message.param_value
        if message.param_id == "LEVEL":
            value = int(value) if cast else struct.unpack("<i", struct.pack("<f", value))[0]
        values[message.param_id] = value if value <= 10 else values[message.param_id]
        tell(message.param_id)
    elif message.get_type() == "SYSTEM_TIME":
        link.mav.debug_vect_send(b"both", 0, values["GAIN"], values["LEVEL"], 0)
"""
FLIGHT = """
[system]
name = "flight"
adapters = ["mavlink"]
reset = { command = ["true"] }

[external]
topics = ["mavlink_raw/gcs/255/190/SYSTEM_TIME"]

[external.parameters]
GAIN = { nominal = 2.0, range = [-9, 20], node = "1/1" }
level = { nominal = 3, range = [-9, 300], node = "1/1", name = "LEVEL" }

[components.vehicle]
command = [
    "{python}", "-m", "riot_bus", "bridge", "mavlink", "--endpoint={endpoint}", "--link=/air=udpin:127.0.0.1:0", "--",
    "{python}", "vehicle.py", "udpout:127.0.0.1:{port}", "AUTOPILOT",
]
inputs = ["mavlink_raw/gcs/255/190/SYSTEM_TIME"]
outputs = ["mavlink_raw/air/1/1/DEBUG_VECT"]
ready = { timeout = 60 }
"""


@pytest.mark.parametrize("autopilot", [3, 12], ids=["integers become floats", "integers keep their bytes"])
def test_parameters_of_a_vehicle(tmp_path: Path, autopilot: int) -> None:
    pytest.importorskip("pymavlink")
    (tmp_path / "vehicle.py").write_text(VEHICLE)
    (tmp_path / "riot.toml").write_text(FLIGHT.replace("AUTOPILOT", str(autopilot)))
    frame = {"system": 255, "component": 190, "version": 2}
    log = tuple(
        Message(
            10**18 + n * 10**8,
            "mavlink_raw/gcs/255/190/SYSTEM_TIME",
            pack_frame(2, bytes(12), 137, sequence=n, **frame),
        )
        for n in range(8)
    )
    chosen: list[dict[str, float]] = [{}, {"GAIN": 3.5, "level": -4}, {"GAIN": 11.0, "level": 200}, {"level": 7}, {}]
    cases = [TestCase(log, tuple(Injection(PARAMETERS, *each) for each in values.items())) for values in chosen]
    names = tuple(f"mavlink_raw/air/1/1/DEBUG_VECT:{field}" for field in "xy")
    with Pool(tmp_path / "riot.toml", 1, keep=tmp_path / "trials") as pool:
        outcomes = [pool.execute(SystemTrial(RunPace(duration=1.0), names), case) for case in cases]
    assert [one.verdict for one in outcomes] == [Verdict.PASS] * 5, [one.detail for one in outcomes]
    found = [tuple(set(one.observed[name].values) for name in names) for one in outcomes]
    assert found == [({2.0}, {3.0}), ({3.5}, {-4.0}), ({2.0}, {3.0}), ({2.0}, {7.0}), ({2.0}, {3.0})]
    assert [one.statistics.get("refused", {}) for one in outcomes] == [
        {},
        {},
        {"GAIN": "1/1 refused 11.0: it answers 3.5", "level": "1/1 refused 200: it answers -4"},
        {},
        {},
    ]
