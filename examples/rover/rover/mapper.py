"""Builds the map, and sends the planner the part of it that comes next."""

from __future__ import annotations

from math import floor, isfinite

from rover.component import Component
from rover.maps import OccupancyGrid, OccupancyGridUpdate
from rover.options import CONNECT, parse
from rover.site import HALF, on_site

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.component import Publish
    from rover.messages import PoseStamped, Stamp
    from rover.sensors import Odometry

UNKNOWN, FREE = 0xFF, 0
COARSE_CELL, FINE_CELL = 2.0, 0.5
COARSE, FINE = int(2 * HALF / COARSE_CELL), int(2 * HALF / FINE_CELL)
MAP_PERIOD = 10.0
ODOMETRY_PER_UPDATE = 5

WINDOW = 8
MARGIN = 20.0
LOOKAHEAD = 1.0
TOP_SPEED = 2.0


def window_origin(goal_x: float, goal_y: float, vx: float, vy: float) -> tuple[int, int]:
    """Give the fine cell where the window starts that the rover needs on its way to a goal.

    The rover comes up from the south, so the window starts a margin south of the goal, and it is shifted against the
    motion, so that what the rover passes until the window arrives is still in it.
    """
    x = floor((goal_x - vx * LOOKAHEAD + HALF) / FINE_CELL)
    y = floor((goal_y - MARGIN - vy * LOOKAHEAD + HALF) / FINE_CELL)
    return min(FINE - 1, max(1, x)), min(FINE - 1, y)


class Grid:
    """Square cells over the site, unknown until the rover has been there."""

    def __init__(self, size: int, cell: float) -> None:
        self._size = size
        self._cell = cell
        self.cells = bytearray([UNKNOWN]) * (size * size)

    def visit(self, x: float, y: float) -> None:
        """Mark a place on the site as free ground."""
        row, column = floor((y + HALF) / self._cell), floor((x + HALF) / self._cell)
        self.cells[row * self._size + column] = FREE

    def window(self, x: int, y: int, size: int) -> bytes:
        """Copy a square of cells; what lies beyond the site is unknown."""
        data = bytearray([UNKNOWN]) * (size * size)
        for row in range(max(0, -y), min(size, self._size - y)):
            start = (y + row) * self._size
            part = self.cells[start + max(0, x) : start + min(self._size, x + size)]
            left = row * size + max(0, -x)
            data[left : left + len(part)] = part
        return bytes(data)


class Mapper(Component):
    """Follows the odometry; knows no time but that of its stamps."""

    NAME = "mapper"
    INPUTS = ("/odom", "/goal")
    OUTPUTS = ("/map", "/map_updates")

    def __init__(self, publish: Publish) -> None:
        super().__init__(publish)
        self._coarse = Grid(COARSE, COARSE_CELL)
        self._fine = Grid(FINE, FINE_CELL)
        self._goal: tuple[float, float] | None = None
        self._velocity = (0.0, 0.0)
        self._seen = 0
        self._map_time: float | None = None

    def on_goal(self, goal: PoseStamped) -> None:
        """Take a goal, if the rover can go there."""
        if on_site(goal.x, goal.y):
            self._goal = goal.x, goal.y
        else:
            self.warn("goal refused", f"({goal.x:g}, {goal.y:g}) is off the map")

    def on_odom(self, odometry: Odometry) -> None:
        """Mark the ground under the rover, and send what is due."""
        self._seen += 1
        if on_site(odometry.x, odometry.y):
            self._coarse.visit(odometry.x, odometry.y)
            self._fine.visit(odometry.x, odometry.y)
        self._velocity = plausible(odometry.vx, self._velocity[0]), plausible(odometry.vy, self._velocity[1])
        self._send_map(odometry.stamp)
        if self._goal and self._seen % ODOMETRY_PER_UPDATE == 0:
            x, y = window_origin(*self._goal, *self._velocity)
            window = self._fine.window(x, y, WINDOW)
            self.publish("/map_updates", OccupancyGridUpdate(odometry.stamp, x, y, WINDOW, WINDOW, window))

    def _send_map(self, stamp: Stamp) -> None:
        time = stamp[0] + stamp[1] * 1e-9
        if self._map_time is None or not 0.0 <= time - self._map_time < MAP_PERIOD:
            self._map_time = time
            grid = OccupancyGrid(stamp, COARSE_CELL, COARSE, COARSE, -HALF, -HALF, bytes(self._coarse.cells))
            self.publish("/map", grid)


def plausible(speed: float, last: float) -> float:
    """Bound a measured speed by what the rover can do; without a measurement, keep the last one."""
    return max(-TOP_SPEED, min(TOP_SPEED, speed)) if isfinite(speed) else last


def main() -> None:
    """Run as a process."""
    options = parse(CONNECT)
    from rover.bus import serve

    serve(Mapper, options.connect)


if __name__ == "__main__":
    main()
