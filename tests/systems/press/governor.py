"""Turns the panel's settings into commands for the drive."""

import json

import zenoh
from link import connect

with connect() as session, session.declare_subscriber("press/panel", zenoh.handlers.FifoChannel(1000)) as panel:
    commands = session.declare_publisher("press/drive/command", congestion_control=zenoh.CongestionControl.BLOCK)
    for number, sample in enumerate(panel):
        reading = json.loads(sample.payload.to_bytes())
        mode = "step" if reading["lever"] > 0.5 else "hold"
        command = {"seq": number, "mode": mode, "speed": reading["knob"] / 20, "note": "from panel", "limits": [5, 9]}
        commands.put(json.dumps(command))
