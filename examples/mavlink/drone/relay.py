"""From MAVLink to ROS 2: where the drone is, as `/drone/fix`. `python -m drone.relay --help`."""

from __future__ import annotations

import argparse
import signal
import sys
from time import monotonic

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drone.link import Link
from drone.ros import FIX, Session, fix

SYSTEM, COMPONENT = 1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
BEAT = 1.0


def main() -> None:
    """Run as a process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", default="udpin:127.0.0.1:14550", help="udpin:, udpout:, tcp: or tcpin:HOST:PORT")
    parser.add_argument("--zenoh", default="tcp/127.0.0.1:7447", help="endpoint of the router")
    options = parser.parse_args()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    with Session(options.zenoh) as session, Link(options.connect, system=SYSTEM, component=COMPONENT) as link:
        fixes = session.publisher(FIX)
        beat = monotonic()
        while True:
            if monotonic() >= beat:
                beat += BEAT
                kind, none = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
                link.send(mavlink.MAVLink_heartbeat_message(kind, none, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))
            for message in link.receive(beat):
                if message.get_type() == "GLOBAL_POSITION_INT":
                    place = message.lat / 1e7, message.lon / 1e7, message.alt / 1000
                    fixes.put(fix(message.time_boot_ms / 1000, *place))


if __name__ == "__main__":
    main()
