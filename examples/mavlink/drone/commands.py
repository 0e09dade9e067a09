"""Commands: what the drone is told to do, and whether it does."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drone.vehicle import Mode, Place, Vehicle

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
DENIED: int = mavlink.MAV_RESULT_DENIED
REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED

HIGHEST = 500.0
FORCE = 21196.0
DEGREES = 1e7
MODES = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Mode.RTL,
    mavlink.MAV_CMD_NAV_LAND: Mode.LAND,
}


def carry_out(vehicle: Vehicle, command: Message) -> int:
    """Carry out a COMMAND_LONG or COMMAND_INT that is about the flight; return a MAV_RESULT."""
    number = command.command
    if number == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        return _arm(vehicle, arm=command.param1 == 1, force=command.param2 == FORCE)
    if number == mavlink.MAV_CMD_DO_SET_MODE:
        return set_mode(vehicle, command.param2)
    if number == mavlink.MAV_CMD_NAV_TAKEOFF:
        height = command.param7 if command.get_type() == "COMMAND_LONG" else command.z
        if not vehicle.armed or vehicle.mode is not Mode.GUIDED or not 0 < height <= HIGHEST:
            return DENIED
        vehicle.target = Place(vehicle.place.latitude, vehicle.place.longitude, height)
        return ACCEPTED
    if number == mavlink.MAV_CMD_MISSION_START:
        if not vehicle.armed or not vehicle.route:
            return DENIED
        vehicle.current = 0
        vehicle.enter(Mode.AUTO)
        return ACCEPTED
    if number == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
        return select(vehicle, command.param1)
    if number == mavlink.MAV_CMD_DO_REPOSITION and command.get_type() == "COMMAND_INT":
        return go_to(vehicle, command.x / DEGREES, command.y / DEGREES, command.z)
    if number in MODES:
        vehicle.enter(MODES[number])
        return ACCEPTED
    return UNSUPPORTED


def set_mode(vehicle: Vehicle, number: float) -> int:
    """Change the mode, if there is such a one."""
    if number not in set(Mode):
        return DENIED
    vehicle.enter(Mode(int(number)))
    return ACCEPTED


def select(vehicle: Vehicle, item: float) -> int:
    """Make an item of the mission the current one."""
    if not 0 <= item < len(vehicle.route):
        return DENIED
    vehicle.select(int(item))
    return ACCEPTED


def go_to(vehicle: Vehicle, latitude: float, longitude: float, height: float) -> int:
    """Fly to a place, if it is one and in reach."""
    place = Place(latitude, longitude, height)
    if vehicle.mode is not Mode.GUIDED or not vehicle.armed:
        return REJECTED
    if not (abs(latitude) <= 90 and abs(longitude) <= 180 and 0 <= height <= HIGHEST):
        return DENIED
    vehicle.target = place
    return ACCEPTED


def _arm(vehicle: Vehicle, *, arm: bool, force: bool) -> int:
    if not arm and vehicle.flying and not force:
        return REJECTED
    vehicle.armed = arm
    return ACCEPTED
