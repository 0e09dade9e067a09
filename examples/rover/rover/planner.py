"""Plans the way from where the rover is to the goal."""

from __future__ import annotations

from math import isfinite

from rover.component import Component
from rover.messages import Path, PoseStamped
from rover.options import CONNECT, parse
from rover.site import on_site
from rover.workspace import Workspace

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.component import Publish
    from rover.maps import OccupancyGrid, OccupancyGridUpdate
    from rover.messages import Stamp
    from rover.sensors import Odometry

MESSAGES_PER_PLAN = 4
LARGEST_GRID = 4_194_304
BOLD, CAREFUL = 4, 8


class Planner(Component):
    """Draws straight lines, in smaller steps where the ground ahead is unknown."""

    NAME = "planner"
    INPUTS = ("/map", "/map_updates", "/odom", "/goal")
    OUTPUTS = ("/plan",)

    def __init__(self, publish: Publish) -> None:
        super().__init__(publish)
        self._workspace = Workspace()
        self._stamp: Stamp = (0, 0)
        self._place: tuple[float, float] | None = None
        self._goal: tuple[float, float] | None = None
        self._explored = 0.0
        self._free_ahead = 0
        self._stale = False
        self._since_plan = MESSAGES_PER_PLAN

    def on_map(self, grid: OccupancyGrid) -> None:
        """Take the whole map."""
        cells = grid.width * grid.height
        usable = isfinite(grid.resolution) and grid.resolution > 0.0 and isfinite(grid.x) and isfinite(grid.y)
        if cells != len(grid.data) or not 0 < cells <= LARGEST_GRID or not usable:
            return self.warn("map refused", f"{grid.width} x {grid.height} cells of {grid.resolution:g} m do not fit")
        self._explored = grid.data.count(0) / cells
        return self._replan(stale=False)

    def on_map_updates(self, update: OccupancyGridUpdate) -> None:
        """Take the window of the map that comes next."""
        window = self._workspace.window(update)
        if update.width * update.height != len(update.data):
            size = f"{update.width} x {update.height}"
            return self.warn("map update refused", f"{size} cells announced, {len(update.data)} there")
        self._free_ahead = window.place(update.data)
        return self._replan(stale=True)

    def on_odom(self, odometry: Odometry) -> None:
        """Take the rover's place."""
        if not on_site(odometry.x, odometry.y):
            return self.warn("odometry refused", f"({odometry.x:g}, {odometry.y:g}) is off the map")
        self._stamp = odometry.stamp
        self._place = odometry.x, odometry.y
        return self._replan(stale=False)

    def on_goal(self, goal: PoseStamped) -> None:
        """Take a goal, if the rover can go there."""
        if not on_site(goal.x, goal.y):
            return self.warn("goal refused", f"({goal.x:g}, {goal.y:g}) is off the map")
        self._goal = goal.x, goal.y
        return self._replan(stale=True)

    def _replan(self, *, stale: bool) -> None:
        self._stale = self._stale or stale
        self._since_plan += 1
        if not self._stale or self._since_plan < MESSAGES_PER_PLAN or not self._place or not self._goal:
            return
        self._stale = False
        self._since_plan = 0
        self.publish("/plan", Path(self._stamp, self._line(self._place, self._goal)))

    def _line(self, start: tuple[float, float], end: tuple[float, float]) -> list[PoseStamped]:
        steps = BOLD if self._free_ahead and self._explored else CAREFUL
        across, up = end[0] - start[0], end[1] - start[1]
        parts = [step / steps for step in range(1, steps + 1)]
        return [PoseStamped(self._stamp, start[0] + across * part, start[1] + up * part) for part in parts]


def main() -> None:
    """Run as a process."""
    options = parse(CONNECT)
    from rover.bus import serve

    serve(Planner, options.connect)


if __name__ == "__main__":
    main()
