"""The base of all messages, and those that say where to go."""

from __future__ import annotations

from struct import Struct

from rover.cdr import UINT32, Reader, Writer

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Self

    Stamp = tuple[int, int]

STAMP = Struct("<iI")
VECTOR = Struct("<3d")
POSE = Struct("<7d")
TWIST = Struct("<6d")


class Message:
    """A ROS 2 message; `TYPE` and `HASH` are what its keys on the bus end with."""

    __slots__ = ()
    TYPE = ""
    HASH = ""

    def encode(self) -> bytes:
        """Give the message in CDR."""
        raise NotImplementedError

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a message from CDR.

        Raises:
            DecodeError: The bytes hold no such message.
        """
        raise NotImplementedError


def put_header(writer: Writer, stamp: Stamp, frame: str) -> None:
    """Append a std_msgs/Header."""
    writer.put(STAMP, 4, *stamp)
    writer.string(frame)


def take_header(reader: Reader) -> Stamp:
    """Take a std_msgs/Header; the rover's frames all coincide, so only the stamp counts."""
    seconds, nanoseconds = reader.take(STAMP, 4)
    reader.skip_string()
    return int(seconds), int(nanoseconds)


class Twist(Message):
    """A velocity command, of which a holonomic rover with a fixed heading uses two axes."""

    __slots__ = ("vx", "vy")
    TYPE = "geometry_msgs/msg/Twist"
    HASH = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"

    def __init__(self, vx: float, vy: float) -> None:
        self.vx = vx
        self.vy = vy

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        writer.put(TWIST, 8, self.vx, self.vy, 0.0, 0.0, 0.0, 0.0)
        return writer.finish()

    @classmethod
    def decode(cls, data: bytes) -> Twist:
        """Read a message from CDR."""
        values = Reader(data).take(TWIST, 8)
        return cls(values[0], values[1])


class PoseStamped(Message):
    """A goal on the plane; `turn` is the quaternion's z and w."""

    __slots__ = ("stamp", "turn", "x", "y")
    TYPE = "geometry_msgs/msg/PoseStamped"
    HASH = "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"

    def __init__(self, stamp: Stamp, x: float, y: float, turn: tuple[float, float] = (0.0, 1.0)) -> None:
        self.stamp = stamp
        self.x = x
        self.y = y
        self.turn = turn

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        self.write(writer)
        return writer.finish()

    def write(self, writer: Writer) -> None:
        """Append the message's content, on its own or within another message."""
        put_header(writer, self.stamp, "map")
        writer.put(POSE, 8, self.x, self.y, 0.0, 0.0, 0.0, *self.turn)

    @classmethod
    def decode(cls, data: bytes) -> PoseStamped:
        """Read a message from CDR."""
        return cls.read(Reader(data))

    @classmethod
    def read(cls, reader: Reader) -> PoseStamped:
        """Take the message's content, on its own or within another message."""
        stamp = take_header(reader)
        x, y, *_, turn_z, turn_w = reader.take(POSE, 8)
        return cls(stamp, x, y, (turn_z, turn_w))


class Path(Message):
    """A plan: poses to pass one after the other."""

    __slots__ = ("poses", "stamp")
    TYPE = "nav_msgs/msg/Path"
    HASH = "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b"

    def __init__(self, stamp: Stamp, poses: list[PoseStamped]) -> None:
        self.stamp = stamp
        self.poses = poses

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "map")
        writer.put(UINT32, 4, len(self.poses))
        for pose in self.poses:
            pose.write(writer)
        return writer.finish()

    @classmethod
    def decode(cls, data: bytes) -> Path:
        """Read a message from CDR."""
        reader = Reader(data)
        stamp = take_header(reader)
        return cls(stamp, [PoseStamped.read(reader) for _ in range(reader.count())])
