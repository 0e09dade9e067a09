"""A ground station made with mavsdk that takes all it can get: `ground.py URL`.

Its plugins need a vehicle, and hear only what comes after they have subscribed. So a heartbeat of its own makes the
vehicle known, and it connects when everything is subscribed and asked for: nothing that comes over the link is missed.
"""

import contextlib
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.camera import Camera
from mavsdk.plugins.events import Events
from mavsdk.plugins.gimbal import Gimbal
from mavsdk.plugins.info import Info
from mavsdk.plugins.mission import Mission
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError
from mavsdk.plugins.param import Param
from mavsdk.plugins.shell import Shell
from mavsdk.plugins.telemetry import Telemetry
from mavsdk.plugins.transponder import Transponder
from pymavlink.dialects.v20 import minimal as mavlink

PATIENCE, TRIES = 60.0, 20
PLUGINS = (Telemetry, Mission, Info, Camera, Gimbal, Events, Shell, Transponder)
PARAM_REQUEST_LIST, MISSION_REQUEST_LIST = 21, 43


def heartbeat():
    """Return a heartbeat of the vehicle, as bytes."""
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
    message = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, mavlink.MAV_STATE_STANDBY, 3
    )
    return message.pack(vehicle)


def ask(request):
    """Ask for something until it is answered, on a thread of its own."""

    def run():
        for _ in range(TRIES):
            with contextlib.suppress(MissionRawError):
                if request():
                    return

    threading.Thread(target=run, daemon=True).start()


def parameters(system):
    """Return the vehicle's parameters, none if it does not answer."""
    found = Param(system).get_all_params()
    return [*found.int_params, *found.float_params, *found.custom_params]


def main(url):
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection("raw://")
    wanted, asked = {PARAM_REQUEST_LIST, MISSION_REQUEST_LIST}, threading.Event()

    def sent(data):
        wanted.discard(int.from_bytes(data[7:10], "little"))
        if not wanted:
            asked.set()

    sdk.subscribe_raw_bytes_to_be_sent(sent)
    sdk.pass_received_raw_bytes(heartbeat())
    system = sdk.first_autopilot(PATIENCE)
    plugins = [make(system) for make in PLUGINS]
    for plugin in plugins:
        for name in dir(plugin):
            if name.startswith("subscribe_"):
                getattr(plugin, name)(lambda *values: None)
    ask(lambda: parameters(system))
    ask(MissionRaw(system).download_mission)
    if not asked.wait(PATIENCE):
        sys.exit("nothing was asked for")
    sdk.add_any_connection(url)
    threading.Event().wait()


main(sys.argv[1])
