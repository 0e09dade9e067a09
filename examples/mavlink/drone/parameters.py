"""Parameters, read and set by name or number."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

INT8, INT16, INT32 = mavlink.MAV_PARAM_TYPE_INT8, mavlink.MAV_PARAM_TYPE_INT16, mavlink.MAV_PARAM_TYPE_INT32
REAL32 = mavlink.MAV_PARAM_TYPE_REAL32
NO_INDEX = 65535

DEFAULTS: dict[str, tuple[float, int]] = {
    "SYSID_THISMAV": (1, INT16),
    "SYSID_MYGCS": (255, INT16),
    "FRAME_CLASS": (1, INT8),
    "FORMAT_VERSION": (120, INT16),
    "ARMING_CHECK": (1, INT32),
    "FENCE_ENABLE": (0, INT8),
    "FENCE_TOTAL": (0, INT8),
    "RALLY_TOTAL": (0, INT8),
    "RTL_ALT": (1500, INT32),
    "WPNAV_SPEED": (800.0, REAL32),
    "WPNAV_SPEED_UP": (300.0, REAL32),
    "WPNAV_RADIUS": (100.0, REAL32),
    "LAND_SPEED": (50, INT16),
    "PILOT_SPEED_UP": (250, INT16),
    "BATT_MONITOR": (4, INT8),
    "BATT_CAPACITY": (5200, INT32),
    "BATT_LOW_VOLT": (10.5, REAL32),
    "BATT_CRT_VOLT": (10.0, REAL32),
    "COMPASS_DEC": (0.0384, REAL32),
    "FLTMODE1": (0, INT8),
    "FLTMODE2": (3, INT8),
    "FLTMODE3": (4, INT8),
    "FLTMODE4": (5, INT8),
    "FLTMODE5": (6, INT8),
    "FLTMODE6": (9, INT8),
    "RC1_MIN": (1000, INT16),
    "RC1_MAX": (2000, INT16),
    "RC2_MIN": (1000, INT16),
    "RC2_MAX": (2000, INT16),
    "RC3_MIN": (1000, INT16),
    "RC3_MAX": (2000, INT16),
    "STAT_FLTTIME": (86400, INT32),
}


class Parameters:
    """The drone's parameters."""

    def __init__(self) -> None:
        self._values = {name: value for name, (value, _) in DEFAULTS.items()}
        self._names = list(DEFAULTS)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def answer(self, message: Message) -> Iterator[Message]:
        """Answer a message about parameters; unknown ones get no answer."""
        match message.get_type():
            case "PARAM_REQUEST_LIST":
                yield from map(self._report, self._names)
            case "PARAM_REQUEST_READ":
                known = 0 <= message.param_index < len(self._names)
                name = self._names[message.param_index] if known else message.param_id
                if name in self._values:
                    yield self._report(name)
            case "PARAM_SET" if message.param_id in self._values:
                self._set(message.param_id, message.param_value)
                yield self._report(message.param_id)

    def _set(self, name: str, value: float) -> None:
        if value != value or abs(value) > 1e9:
            return
        self._values[name] = value if DEFAULTS[name][1] == REAL32 else round(value)

    def _report(self, name: str) -> Message:
        kind, index = DEFAULTS[name][1], self._names.index(name)
        return mavlink.MAVLink_param_value_message(
            name.encode(), float(self._values[name]), kind, len(self._names), index
        )
