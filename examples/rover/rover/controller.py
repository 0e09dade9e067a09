"""Turns the plan into velocity commands."""

from __future__ import annotations

from math import hypot, isfinite

from rover.component import Component
from rover.messages import Path, Twist
from rover.options import CONNECT, parse
from rover.site import on_site

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.component import Publish
    from rover.sensors import Odometry

CRUISE = 1.4
GAIN = 0.8
REACHED = 1.0
ODOMETRY_PER_COMMAND = 2


class Controller(Component):
    """Steers to the poses of the plan one after the other, slower near the last."""

    NAME = "controller"
    INPUTS = ("/plan", "/odom")
    OUTPUTS = ("/cmd_vel",)

    def __init__(self, publish: Publish) -> None:
        super().__init__(publish)
        self._poses: list[tuple[float, float]] = []
        self._seen = 0

    def on_plan(self, plan: Path) -> None:
        """Take a plan whose poses all lie on the map."""
        poses = [(pose.x, pose.y) for pose in plan.poses]
        if all(on_site(*pose) for pose in poses):
            self._poses = poses
        else:
            self.warn("plan refused", "it leaves the map")

    def on_odom(self, odometry: Odometry) -> None:
        """Steer from where the rover is."""
        self._seen += 1
        if self._seen % ODOMETRY_PER_COMMAND:
            return
        if not (isfinite(odometry.x) and isfinite(odometry.y)):
            self.warn("odometry refused", "the place is not a number")
            return
        while len(self._poses) > 1 and distance(odometry, self._poses[0]) < REACHED:
            self._poses.pop(0)
        self.publish("/cmd_vel", self._steer(odometry))

    def _steer(self, odometry: Odometry) -> Twist:
        if not self._poses:
            return Twist(0.0, 0.0)
        x, y = self._poses[0]
        away = distance(odometry, (x, y))
        speed = min(CRUISE, GAIN * away)
        scale = speed / away if away > 0.0 else 0.0
        return Twist((x - odometry.x) * scale, (y - odometry.y) * scale)


def distance(odometry: Odometry, pose: tuple[float, float]) -> float:
    """Give the way from the rover to a pose."""
    return hypot(pose[0] - odometry.x, pose[1] - odometry.y)


def main() -> None:
    """Run as a process."""
    options = parse(CONNECT)
    from rover.bus import serve

    serve(Controller, options.connect)


if __name__ == "__main__":
    main()
