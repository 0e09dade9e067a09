"""A ground station made with dronekit that looks at all that its vehicle object offers: `ground.py URL`.

It is ready as soon as it has connected: dronekit's own `connect` waits for a vehicle first.
"""

import collections
import collections.abc
import sys
import threading

collections.MutableMapping = collections.abc.MutableMapping  # dronekit 2.9.2 is older than Python 3.10

from dronekit import Vehicle, connect  # noqa: E402

LOOKED_AT = [name for name in dir(Vehicle) if isinstance(getattr(Vehicle, name), property)]
LOOKED_AT.remove("capabilities")  # raises TypeError until the vehicle has sent AUTOPILOT_VERSION


def look(vehicle, name, message):
    for attribute in LOOKED_AT:
        getattr(vehicle, attribute)


vehicle = connect(sys.argv[1], _initialize=False)
vehicle.add_message_listener("*", look)
vehicle._handler.start()
threading.Event().wait()
