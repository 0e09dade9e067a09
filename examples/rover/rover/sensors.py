"""Messages from the rover's sensors."""

from __future__ import annotations

from struct import Struct

from rover.cdr import Reader, Writer
from rover.messages import VECTOR, Message, put_header, take_header

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.messages import Stamp

    Vector = tuple[float, float, float]

POSE_COVARIANCE = Struct("<7d36d")
TWIST_COVARIANCE = Struct("<6d36d")
POSITION_ONLY = Struct("<2d328x")
VELOCITY_ONLY = Struct("<2d320x")
ORIENTATION_COVARIANCE = Struct("<4d9d")
VECTOR_COVARIANCE = Struct("<3d9d")
FIX_STATUS = Struct("<b")
FIX_SERVICE = Struct("<H")
FIX_END = Struct("<9dB")
BATTERY = Struct("<7f3B?")


def diagonal(size: int, variance: float) -> tuple[float, ...]:
    """Give a covariance matrix of independent quantities, row by row."""
    return tuple(variance if i % (size + 1) == 0 else 0.0 for i in range(size * size))


POSE_VARIANCE = diagonal(6, 0.02**2)
TWIST_VARIANCE = diagonal(6, 0.05**2)
IMU_VARIANCE = diagonal(3, 0.01**2)
FIX_VARIANCE = diagonal(3, 1.5**2)


class Odometry(Message):
    """Position and velocity on the plane."""

    __slots__ = ("stamp", "vx", "vy", "x", "y")
    TYPE = "nav_msgs/msg/Odometry"
    HASH = "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"

    def __init__(self, stamp: Stamp, x: float, y: float, vx: float, vy: float) -> None:
        self.stamp = stamp
        self.x = x
        self.y = y
        self.vx = vx
        self.vy = vy

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "odom")
        writer.string("base_link")
        writer.put(POSE_COVARIANCE, 8, self.x, self.y, 0.0, 0.0, 0.0, 0.0, 1.0, *POSE_VARIANCE)
        writer.put(TWIST_COVARIANCE, 8, self.vx, self.vy, 0.0, 0.0, 0.0, 0.0, *TWIST_VARIANCE)
        return writer.finish()

    @classmethod
    def decode(cls, data: bytes) -> Odometry:
        """Read a message from CDR."""
        reader = Reader(data)
        stamp = take_header(reader)
        reader.skip_string()
        x, y = reader.take(POSITION_ONLY, 8)
        vx, vy = reader.take(VELOCITY_ONLY, 8)
        return cls(stamp, x, y, vx, vy)


class Imu(Message):
    """Turn rates and accelerations; the heading is fixed."""

    __slots__ = ("acceleration", "rates", "stamp")
    TYPE = "sensor_msgs/msg/Imu"
    HASH = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"

    def __init__(self, stamp: Stamp, rates: Vector, acceleration: Vector) -> None:
        self.stamp = stamp
        self.rates = rates
        self.acceleration = acceleration

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "imu_link")
        writer.put(ORIENTATION_COVARIANCE, 8, 0.0, 0.0, 0.0, 1.0, *IMU_VARIANCE)
        writer.put(VECTOR_COVARIANCE, 8, *self.rates, *IMU_VARIANCE)
        writer.put(VECTOR_COVARIANCE, 8, *self.acceleration, *IMU_VARIANCE)
        return writer.finish()


class NavSatFix(Message):
    """A satellite fix: latitude, longitude (degrees), altitude (metres)."""

    __slots__ = ("place", "stamp")
    TYPE = "sensor_msgs/msg/NavSatFix"
    HASH = "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"
    GPS = 1
    DIAGONAL_KNOWN = 2

    def __init__(self, stamp: Stamp, place: Vector) -> None:
        self.stamp = stamp
        self.place = place

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "gps_link")
        writer.put(FIX_STATUS, 1, 0)
        writer.put(FIX_SERVICE, 2, self.GPS)
        writer.put(VECTOR, 8, *self.place)
        writer.put(FIX_END, 8, *FIX_VARIANCE, self.DIAGONAL_KNOWN)
        return writer.finish()


class BatteryState(Message):
    """State of the traction battery."""

    __slots__ = ("charge", "current", "stamp", "temperature", "voltage")
    TYPE = "sensor_msgs/msg/BatteryState"
    HASH = "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741"
    CAPACITY = 20.0
    DISCHARGING, GOOD, LITHIUM_ION = 2, 1, 2

    def __init__(self, stamp: Stamp, voltage: float, current: float, charge: float, temperature: float) -> None:
        self.stamp = stamp
        self.voltage = voltage
        self.current = current
        self.charge = charge
        self.temperature = temperature

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "battery")
        amounts = (self.charge, self.CAPACITY, self.CAPACITY, self.charge / self.CAPACITY)
        state = (self.DISCHARGING, self.GOOD, self.LITHIUM_ION, True)
        writer.put(BATTERY, 4, self.voltage, self.temperature, self.current, *amounts, *state)
        writer.sequence("f", [])
        writer.sequence("f", [])
        writer.string("chassis")
        writer.string("")
        return writer.finish()


class Joy(Message):
    """The operator's hand controller, which only has to lie there."""

    __slots__ = ("axes", "buttons", "stamp")
    TYPE = "sensor_msgs/msg/Joy"
    HASH = "RIHS01_0d356c79cad3401e35ffeb75a96a96e08be3ef896b8b83841d73e890989372c5"

    def __init__(self, stamp: Stamp, axes: list[float], buttons: list[int]) -> None:
        self.stamp = stamp
        self.axes = axes
        self.buttons = buttons

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "joy")
        writer.sequence("f", self.axes)
        writer.sequence("i", self.buttons)
        return writer.finish()
