"""Telemetry: what the drone says of itself, and how often."""

from __future__ import annotations

from math import cos, pi, radians

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drone.vehicle import HOME, METRES_PER_DEGREE, Mode, Vehicle

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

GROUND = HOME[2]
CELLS, FULL = 3, 5200
NONE_U16, NONE_U8 = 65535, 255
SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_GEOFENCE
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)
CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
EKF_GOOD = 0x33F


def _ms(vehicle: Vehicle) -> int:
    return int(vehicle.time * 1000)


def _us(vehicle: Vehicle) -> int:
    return int(vehicle.time * 1_000_000)


def _place(vehicle: Vehicle) -> tuple[int, int]:
    return round(vehicle.place.latitude * 1e7), round(vehicle.place.longitude * 1e7)


def heartbeat(vehicle: Vehicle) -> Message:
    """The mode, and whether it is armed."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.armed else 0
    flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED if vehicle.mode in (Mode.GUIDED, Mode.AUTO) else 0
    state = mavlink.MAV_STATE_ACTIVE if vehicle.armed else mavlink.MAV_STATE_STANDBY
    kind, make = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    return mavlink.MAVLink_heartbeat_message(kind, make, flags, int(vehicle.mode), state, 3)


def sys_status(vehicle: Vehicle) -> Message:
    """Sensors and battery."""
    volts, amperes = round(vehicle.voltage * 1000), 1200 if vehicle.armed else 120
    left = round(vehicle.battery * 100)
    return mavlink.MAVLink_sys_status_message(
        SENSORS, SENSORS, SENSORS, 310, volts, amperes, left, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )


def battery_status(vehicle: Vehicle) -> Message:
    """Battery, cell by cell."""
    cells = [round(vehicle.voltage * 1000 / CELLS)] * CELLS + [NONE_U16] * (10 - CELLS)
    used, left = round((1 - vehicle.battery) * FULL), round(vehicle.battery * 100)
    amperes = 1200 if vehicle.armed else 120
    return mavlink.MAVLink_battery_status_message(0, 0, 1, 3120, cells, amperes, used, -1, left, 0, 1)


def gps_raw_int(vehicle: Vehicle) -> Message:
    """What the GPS says."""
    latitude, longitude = _place(vehicle)
    height = round((vehicle.place.height + GROUND) * 1000)
    speed, course = round(vehicle.speed * 100), round(vehicle.heading * 100)
    return mavlink.MAVLink_gps_raw_int_message(
        _us(vehicle), 3, latitude, longitude, height, 80, 120, speed, course, 14, height, 400, 600, 120, 0, 0
    )


def global_position_int(vehicle: Vehicle) -> Message:
    """Where it is, and how fast."""
    above = vehicle.place.height + vehicle.noise.gauss(0, 0.02)
    speeds = [round(100 * value) for value in (vehicle.north, vehicle.east, -vehicle.up)]
    heights = [round((above + GROUND) * 1000), round(above * 1000)]
    heading = round(vehicle.heading * 100) % 36000
    return mavlink.MAVLink_global_position_int_message(_ms(vehicle), *_place(vehicle), *heights, *speeds, heading)


def local_position_ned(vehicle: Vehicle) -> Message:
    """Metres from home."""
    north = (vehicle.place.latitude - HOME[0]) * METRES_PER_DEGREE
    east = (vehicle.place.longitude - HOME[1]) * METRES_PER_DEGREE * cos(radians(HOME[0]))
    return mavlink.MAVLink_local_position_ned_message(
        _ms(vehicle), north, east, -vehicle.place.height, vehicle.north, vehicle.east, -vehicle.up
    )


def attitude(vehicle: Vehicle) -> Message:
    """Angles, in radians."""
    tilt, wobble = vehicle.speed * 0.02, vehicle.noise.gauss
    yaw = vehicle.yaw - 2 * pi if vehicle.yaw > pi else vehicle.yaw
    roll, pitch = wobble(0, 0.004), -tilt + wobble(0, 0.004)
    return mavlink.MAVLink_attitude_message(_ms(vehicle), roll, pitch, yaw, wobble(0, 0.01), wobble(0, 0.01), 0.0)


def vfr_hud(vehicle: Vehicle) -> Message:
    """What a pilot looks at."""
    throttle = (52 if vehicle.flying else 12) if vehicle.armed else 0
    height = vehicle.place.height + GROUND
    return mavlink.MAVLink_vfr_hud_message(
        vehicle.speed, vehicle.speed, round(vehicle.heading) % 360, throttle, height, vehicle.up
    )


def nav_controller_output(vehicle: Vehicle) -> Message:
    """How far the target is."""
    target = vehicle.target or vehicle.place
    bearing = round(vehicle.heading)
    distance = min(65535, round(vehicle.metres_to(target)))
    above = target.height - vehicle.place.height
    return mavlink.MAVLink_nav_controller_output_message(0.0, 0.0, bearing, bearing, distance, above, 0.0, 0.0)


def mission_current(vehicle: Vehicle) -> Message:
    """Which item of the mission it flies to."""
    return mavlink.MAVLink_mission_current_message(vehicle.current, len(vehicle.route), 0, 0)


def rc_channels(vehicle: Vehicle) -> Message:
    """The sticks, in the middle."""
    sticks = [1500 + round(vehicle.noise.gauss(0, 1)) for _ in range(4)]
    return mavlink.MAVLink_rc_channels_message(_ms(vehicle), 8, *sticks, *[1500] * 4, *[NONE_U16] * 10, 98)


def servo_output_raw(vehicle: Vehicle) -> Message:
    """The motors."""
    motors = [1480 + round(vehicle.noise.gauss(0, 12)) if vehicle.flying else 1000 for _ in range(4)]
    return mavlink.MAVLink_servo_output_raw_message(_us(vehicle), 0, *motors, 0, 0, 0, 0)


def raw_imu(vehicle: Vehicle) -> Message:
    """Raw sensors."""
    noise = [round(vehicle.noise.gauss(0, 8)) for _ in range(6)]
    return mavlink.MAVLink_raw_imu_message(
        _us(vehicle), noise[0], noise[1], noise[2] - 1000, *noise[3:], 215, 20, 430, 0, 3200
    )


def scaled_pressure(vehicle: Vehicle) -> Message:
    """The air."""
    pressure = 955.0 - vehicle.place.height * 0.115 + vehicle.noise.gauss(0, 0.02)
    return mavlink.MAVLink_scaled_pressure_message(_ms(vehicle), pressure, 0.0, 2150, 0)


def vibration(vehicle: Vehicle) -> Message:
    """How much it shakes."""
    shake = [abs(vehicle.noise.gauss(4 if vehicle.flying else 0.2, 0.4)) for _ in range(3)]
    return mavlink.MAVLink_vibration_message(_us(vehicle), *shake, 0, 0, 0)


def ekf_status_report(vehicle: Vehicle) -> Message:
    """How sure it is of where it is."""
    variances = [abs(vehicle.noise.gauss(0.03, 0.01)) for _ in range(5)]
    return mavlink.MAVLink_ekf_status_report_message(EKF_GOOD, *variances, 0.0)


def system_time(vehicle: Vehicle) -> Message:
    """Its clock; it has none that knows the date."""
    return mavlink.MAVLink_system_time_message(0, _ms(vehicle))


def power_status(vehicle: Vehicle) -> Message:
    """The board's supply."""
    return mavlink.MAVLink_power_status_message(5000 + round(vehicle.noise.gauss(0, 15)), 0, 1)


def home_position(vehicle: Vehicle) -> Message:
    """Where it started."""
    latitude, longitude = round(vehicle.home.latitude * 1e7), round(vehicle.home.longitude * 1e7)
    upright = [1.0, 0.0, 0.0, 0.0]
    return mavlink.MAVLink_home_position_message(
        latitude, longitude, round(GROUND * 1000), 0.0, 0.0, 0.0, upright, 0.0, 0.0, 0.0, _us(vehicle)
    )


def extended_sys_state(vehicle: Vehicle) -> Message:
    """Whether it is on the ground."""
    landed = mavlink.MAV_LANDED_STATE_IN_AIR if vehicle.flying else mavlink.MAV_LANDED_STATE_ON_GROUND
    return mavlink.MAVLink_extended_sys_state_message(0, landed)


def distance_sensor(vehicle: Vehicle) -> Message:
    """The rangefinder that looks down."""
    seen = min(4000, max(20, round(100 * (vehicle.place.height + 0.2))))
    return mavlink.MAVLink_distance_sensor_message(_ms(vehicle), 20, 4000, seen, 0, 1, 25, 0)


def rpm(vehicle: Vehicle) -> Message:
    """How fast two of the motors turn."""
    turns = [abs(vehicle.noise.gauss(5200 if vehicle.flying else 1500 * vehicle.armed, 20)) for _ in range(2)]
    return mavlink.MAVLink_rpm_message(*turns)


def adsb_vehicle(vehicle: Vehicle) -> Message:
    """An airliner that passes far above, as the ADS-B receiver sees it."""
    longitude = round((HOME[1] + vehicle.time * 0.0025) * 1e7) % 1_800_000_000
    flags = 0x1F
    return mavlink.MAVLink_adsb_vehicle_message(
        0x4B1812, round((HOME[0] + 0.05) * 1e7), longitude, 0, 9_800_000, 9000, 21000, 0, b"SWR123", 3, 1, flags, 1000
    )


def autopilot_version(vehicle: Vehicle) -> Message:
    """What it can do; on request."""
    version = 4 << 24 | 5 << 16 | 255
    return mavlink.MAVLink_autopilot_version_message(CAPABILITIES, version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 1)


STREAMS: dict[Callable[[Vehicle], Message], float] = {
    heartbeat: 1,
    attitude: 10,
    global_position_int: 4,
    vfr_hud: 4,
    gps_raw_int: 2,
    local_position_ned: 2,
    nav_controller_output: 2,
    rc_channels: 2,
    servo_output_raw: 2,
    raw_imu: 2,
    scaled_pressure: 2,
    sys_status: 1,
    battery_status: 1,
    mission_current: 1,
    vibration: 1,
    ekf_status_report: 1,
    system_time: 1,
    power_status: 1,
    home_position: 0.5,
    extended_sys_state: 1,
    distance_sensor: 2,
    adsb_vehicle: 1,
    rpm: 2,
}
"""What is sent by itself, and how often per second."""

REPORTS = {
    getattr(mavlink, f"MAVLINK_MSG_ID_{report.__name__.upper()}"): report for report in (*STREAMS, autopilot_version)
}
"""What can be asked for, by message id."""
