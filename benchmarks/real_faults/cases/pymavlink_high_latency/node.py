"""Follows a vehicle by radio and satellite: what comes from the bus is packed, sent to a MAVLink link, and read there.

Values that do not fit into a message are refused when it is packed.
"""

import os
import socket
import struct

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

REFUSED = (struct.error,)


def node(publish, checked):
    link = mavutil.mavlink_connection("udpin:127.0.0.1:0")
    vehicle = mavutil.mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    radio = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def receive(message):
        radio.sendto(message.pack(vehicle), link.port.getsockname())
        found = link.recv_match(blocking=True, timeout=1)
        if found is not None and link.sysid:
            publish("vehicle", {"by": found.get_type(), "mode": link.flightmode, "armed": bool(link.motors_armed())})

    def heartbeat(m):
        receive(mavutil.mavlink.MAVLink_heartbeat_message(**m))

    def satellite(m):
        receive(mavutil.mavlink.MAVLink_high_latency2_message(**m))

    return {"heartbeat": heartbeat, "satellite": satellite}
