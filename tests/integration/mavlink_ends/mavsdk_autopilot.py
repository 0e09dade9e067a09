"""An autopilot made with mavsdk's servers, run in an environment that has it: `mavsdk_autopilot.py URL`.

Flies until its standard input ends, then prints what it was told as one JSON object.
"""

import json
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action_server import ActionServer
from mavsdk.plugins.mission_raw_server import MissionRawServer, MissionRawServerResult
from mavsdk.plugins.param_server import ParamServer
from mavsdk.plugins.telemetry_server import Heading, Position, TelemetryServer, VelocityNed

PERIOD = 0.1


def main(url):
    told = {"armed": [], "missions": [], "params": []}
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
    params = ParamServer(sdk.server_component())
    params.provide_param_int("RTL_ALT", 1500)
    params.provide_param_float("WPNAV_SPEED", 800.0)
    params.subscribe_changed_param_int(lambda each, _=None: told["params"].append([each.name, each.value]))
    action = ActionServer(sdk.server_component())
    action.set_armable(True, True)
    action.set_disarmable(True, True)
    action.set_allow_takeoff(True)
    action.subscribe_arm_disarm(lambda result, each, _=None: told["armed"].append(each.arm))
    missions = MissionRawServer(sdk.server_component())

    def on_mission(result, plan, _=None):
        if result == MissionRawServerResult.SUCCESS:  # on a loaded machine one may be given up, and come again
            told["missions"].append(len(plan.mission_items))

    missions.subscribe_incoming_mission(on_mission)
    telemetry = TelemetryServer(sdk.server_component())
    told["connection"] = str(sdk.add_any_connection(url))
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.wait(PERIOD):
        telemetry.publish_position(Position(47.397742, 8.545594, 488.0, 0.0), VelocityNed(0, 0, 0), Heading(90))
    print(json.dumps(told), flush=True)


main(sys.argv[1])
