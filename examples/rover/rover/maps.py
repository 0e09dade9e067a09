"""Messages that carry pieces of the map."""

from __future__ import annotations

from struct import Struct

from rover.cdr import Reader, Writer
from rover.messages import POSE, Message, put_header, take_header

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.messages import Stamp

INFO = Struct("<iIfII")
WINDOW = Struct("<iiII")


class OccupancyGrid(Message):
    """A whole map; cells are signed bytes, row by row from its south-west corner."""

    __slots__ = ("data", "height", "resolution", "stamp", "width", "x", "y")
    TYPE = "nav_msgs/msg/OccupancyGrid"
    HASH = "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"

    def __init__(
        self, stamp: Stamp, resolution: float, width: int, height: int, x: float, y: float, data: bytes
    ) -> None:
        self.stamp = stamp
        self.resolution = resolution
        self.width = width
        self.height = height
        self.x = x
        self.y = y
        self.data = data

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "map")
        writer.put(INFO, 4, *self.stamp, self.resolution, self.width, self.height)
        writer.put(POSE, 8, self.x, self.y, 0.0, 0.0, 0.0, 0.0, 1.0)
        writer.octets(self.data)
        return writer.finish()

    @classmethod
    def decode(cls, data: bytes) -> OccupancyGrid:
        """Read a message from CDR."""
        reader = Reader(data)
        stamp = take_header(reader)
        _, _, resolution, width, height = reader.take(INFO, 4)
        x, y, *_ = reader.take(POSE, 8)
        return cls(stamp, resolution, int(width), int(height), x, y, reader.octets())


class OccupancyGridUpdate(Message):
    """A window of the map whose south-west cell is (x, y)."""

    __slots__ = ("data", "height", "stamp", "width", "x", "y")
    TYPE = "map_msgs/msg/OccupancyGridUpdate"
    HASH = "RIHS01_c4095b0be2e4363f8978a1570e0293ee093436f1e1c61d99b48502ac317025e8"

    def __init__(self, stamp: Stamp, x: int, y: int, width: int, height: int, data: bytes) -> None:
        self.stamp = stamp
        self.x = x
        self.y = y
        self.width = width
        self.height = height
        self.data = data

    def encode(self) -> bytes:
        """Give the message in CDR."""
        writer = Writer()
        put_header(writer, self.stamp, "map")
        writer.put(WINDOW, 4, self.x, self.y, self.width, self.height)
        writer.octets(self.data)
        return writer.finish()

    @classmethod
    def decode(cls, data: bytes) -> OccupancyGridUpdate:
        """Read a message from CDR."""
        reader = Reader(data)
        stamp = take_header(reader)
        x, y, width, height = reader.take(WINDOW, 4)
        return cls(stamp, int(x), int(y), int(width), int(height), reader.octets())
