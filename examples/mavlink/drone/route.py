"""The route that is flown: a square of some 50 metres, and home."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drone.vehicle import HOME

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

ROUTE = (
    (mavlink.MAV_CMD_NAV_WAYPOINT, 0.0, 0.0, 0.0),
    (mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 15.0),
    (mavlink.MAV_CMD_NAV_WAYPOINT, 0.0005, 0.0, 20.0),
    (mavlink.MAV_CMD_NAV_WAYPOINT, 0.0005, 0.0007, 25.0),
    (mavlink.MAV_CMD_NAV_WAYPOINT, 0.0, 0.0007, 20.0),
    (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0.0, 0.0, 0.0),
)
"""Command, degrees north and east of home, metres above it; the first item is home itself."""


def route_item(number: int, system: int, component: int) -> Message:
    """Return an item of the route for a system and component, as MISSION_ITEM_INT."""
    command, north, east, height = ROUTE[number]
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT if number else mavlink.MAV_FRAME_GLOBAL
    x, y = round((HOME[0] + north) * 1e7), round((HOME[1] + east) * 1e7)
    rest = (frame, command, int(number == 0), 1, 0.0, 0.0, 0.0, 0.0, x, y, height if number else HOME[2])
    return mavlink.MAVLink_mission_item_int_message(system, component, number, *rest, 0)
