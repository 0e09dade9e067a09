"""A ground station made with mavsdk that takes all it can get: `ground.py URL`."""

import contextlib
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.camera import Camera
from mavsdk.plugins.events import Events
from mavsdk.plugins.gimbal import Gimbal
from mavsdk.plugins.info import Info
from mavsdk.plugins.mission import Mission
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.param import Param, ParamError
from mavsdk.plugins.shell import Shell
from mavsdk.plugins.telemetry import Telemetry
from mavsdk.plugins.transponder import Transponder

PATIENCE = 60.0
PLUGINS = (Telemetry, MissionRaw, Mission, Info, Camera, Gimbal, Events, Shell, Transponder)


def main(url):
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(url)
    system = sdk.first_autopilot(PATIENCE)
    if system is None:
        return
    plugins = [make(system) for make in PLUGINS]
    for plugin in plugins:
        for name in dir(plugin):
            if name.startswith("subscribe_"):
                getattr(plugin, name)(lambda *values: None)
    with contextlib.suppress(ParamError):  # nobody answers
        Param(system).get_all_params()
    threading.Event().wait()


main(sys.argv[1])
