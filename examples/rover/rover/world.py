"""The rover's body and the ground it drives on."""

from __future__ import annotations

from math import isfinite

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.messages import Twist

TOP_SPEED = 1.5
RESPONSE = 0.4
COMMAND_LIFE = 1.0


class Body:
    """A holonomic rover with a fixed heading; its wheels follow a command with a lag."""

    def __init__(self) -> None:
        self.x = self.y = 0.0
        self.vx = self.vy = 0.0
        self.ax = self.ay = 0.0
        self._wanted = (0.0, 0.0)
        self._age = 0.0

    def command(self, twist: Twist) -> None:
        """Take a velocity command; wheels cannot do what is beyond their top speed."""
        if isfinite(twist.vx) and isfinite(twist.vy):
            self._wanted = (limit(twist.vx), limit(twist.vy))
            self._age = 0.0

    def step(self, dt: float) -> None:
        """Drive on; without fresh commands, brake."""
        self._age += dt
        wanted_x, wanted_y = self._wanted if self._age <= COMMAND_LIFE else (0.0, 0.0)
        self.ax = (wanted_x - self.vx) / RESPONSE
        self.ay = (wanted_y - self.vy) / RESPONSE
        self.vx += self.ax * dt
        self.vy += self.ay * dt
        self.x += self.vx * dt
        self.y += self.vy * dt


def limit(speed: float) -> float:
    """Bound a speed along one axis."""
    return max(-TOP_SPEED, min(TOP_SPEED, speed))
