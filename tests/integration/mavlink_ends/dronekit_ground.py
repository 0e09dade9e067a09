"""A ground station made with dronekit, run in an environment that has it: `dronekit_ground.py URL`.

Prints what it has seen as one JSON object.
"""

import collections
import collections.abc
import json
import sys
import time

collections.MutableMapping = collections.abc.MutableMapping  # dronekit 2.9.2 is older than Python 3.10

from dronekit import Command, LocationGlobalRelative, VehicleMode, connect  # noqa: E402

PATIENCE = 20.0
HOME = 47.397742, 8.545594


def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit("waited in vain")
        time.sleep(0.02)
    return condition()


def item(command, latitude, longitude, height, frame=3):
    return Command(0, 0, 0, frame, command, 0, 1, 0, 0, 0, 0, latitude, longitude, height)


def main(url):
    vehicle = connect(url, wait_ready=True, heartbeat_timeout=PATIENCE, timeout=PATIENCE)
    report = {"parameters": len(vehicle.parameters), "satellites": vehicle.gps_0.satellites_visible}
    report["version"] = until(lambda: vehicle.version.major)
    report["altitude"] = until(lambda: vehicle.location.global_frame.alt)
    vehicle.parameters["RTL_ALT"] = 2000
    report["set"] = until(lambda: vehicle.parameters["RTL_ALT"] == 2000)

    commands = vehicle.commands
    commands.clear()
    commands.add(item(16, *HOME, 488, 0))
    commands.add(item(22, *HOME, 20))
    commands.add(item(16, HOME[0] + 0.0005, HOME[1], 25))
    commands.upload()
    commands.clear()
    commands.download()
    commands.wait_ready()
    report["mission"] = [[each.command, each.frame, round(each.x, 6), round(each.y, 6), each.z] for each in commands]

    vehicle.mode = VehicleMode("GUIDED")
    until(lambda: vehicle.mode.name == "GUIDED")
    vehicle.armed = True
    report["armed"] = until(lambda: vehicle.armed)
    vehicle.simple_takeoff(5)
    report["in_air"] = until(lambda: vehicle.location.global_relative_frame.alt > 2)
    vehicle.simple_goto(LocationGlobalRelative(HOME[0] + 0.0001, HOME[1], 5))
    report["moves"] = until(lambda: vehicle.groundspeed > 1)
    vehicle.mode = VehicleMode("LAND")
    report["mode"] = until(lambda: vehicle.mode.name == "LAND" and "LAND")
    report["lost"] = vehicle._master.mav_loss
    vehicle.close()
    print(json.dumps(report), flush=True)


main(sys.argv[1])
