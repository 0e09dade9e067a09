"""Keeps a battery warm: how much its heater has to do, from readings and from the temperature that is wanted."""

import math

from simple_pid import PID


def node(publish, checked):
    pid = PID(4.0, 0.4, 0.2, setpoint=20.0, sample_time=None, output_limits=(0.0, 100.0))

    def wanted(m):
        celsius = min(max(m["celsius"], 0.0), 45.0)
        if not (checked and math.isnan(celsius)):
            pid.setpoint = celsius

    def reading(m):
        celsius = min(max(m["celsius"], -40.0), 125.0)  # what the sensor can tell
        if m["volts"] < 9.0 or (checked and math.isnan(celsius)):
            return
        duty = pid(celsius, dt=0.1)
        publish("heater", {"duty": duty, "full": duty >= 100.0})

    return {"wanted": wanted, "reading": reading}
