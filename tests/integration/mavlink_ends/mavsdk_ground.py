"""A ground station made with mavsdk, run in an environment that has it: `mavsdk_ground.py URL`.

Prints what it has seen as one JSON object.
"""

import json
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

PATIENCE = 20.0
HOME = 473977420, 85455940


def seen(subscribe, wanted, values=None):
    """Wait until a stream has brought a value that is wanted; return it."""
    found, arrived = [], threading.Event()

    def take(value, _=None):
        if not arrived.is_set() and wanted(value):
            found.append(value)
            arrived.set()

    subscribe(take)
    if not arrived.wait(PATIENCE):
        raise SystemExit(f"{subscribe.__name__}: nothing came")
    return found[0]


def item(number, command, latitude, longitude, height, frame=3):
    return MissionItem(number, frame, command, int(number == 0), 1, 0.0, 0.0, 0.0, 0.0, latitude, longitude, height, 0)


def main(url):
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    report = {"connection": str(sdk.add_any_connection(url))}
    system = sdk.first_autopilot(PATIENCE)
    if system is None:
        raise SystemExit("no autopilot")
    report["system"] = [system.get_system_id(), system.is_connected(), system.autopilot_type().name]
    telemetry, param, action, mission = Telemetry(system), Param(system), Action(system), MissionRaw(system)

    report["altitude"] = seen(telemetry.subscribe_position, lambda each: True).absolute_altitude_m
    report["satellites"] = seen(telemetry.subscribe_gps_info, lambda each: True).num_satellites
    everything = param.get_all_params()
    report["parameters"] = len(everything.int_params) + len(everything.float_params)
    param.set_param_int("RTL_ALT", 2000)
    param.set_param_float("WPNAV_RADIUS", 250.0)
    report["set"] = [param.get_param_int("RTL_ALT"), param.get_param_float("WPNAV_RADIUS")]

    route = [item(0, 16, *HOME, 488.0, 0), item(1, 22, *HOME, 20.0), item(2, 16, HOME[0] + 5000, HOME[1], 25.0)]
    mission.upload_mission(route)
    back = mission.download_mission()
    report["mission"] = [[each.command, each.frame, each.x, each.y, each.z] for each in back]

    action.arm()
    report["armed"] = seen(telemetry.subscribe_armed, lambda each: each)
    action.takeoff()
    report["in_air"] = seen(telemetry.subscribe_in_air, lambda each: each)
    mission.start_mission()
    report["progress"] = seen(mission.subscribe_mission_progress, lambda each: each.current > 0).total
    action.land()
    report["mode"] = seen(telemetry.subscribe_flight_mode, lambda each: each.name == "LAND").name
    print(json.dumps(report), flush=True)


main(sys.argv[1])
