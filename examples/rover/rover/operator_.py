"""The outside world: someone who sends the rover on patrol."""

from __future__ import annotations

from math import cos, pi, sin

from rover.clock import stamp_of, ticks
from rover.component import Component
from rover.messages import PoseStamped
from rover.noise import Noise
from rover.options import PACED, parse

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.component import Publish

RATE = 2
PATROL = 60.0


class Operator(Component):
    """Names points of interest, often before the rover has reached the one before."""

    NAME = "operator"
    OUTPUTS = ("/goal",)

    def __init__(self, publish: Publish, seed: int) -> None:
        super().__init__(publish)
        self._noise = Noise(seed)
        self._left = 0

    def tick(self, tick: int) -> None:
        """Send the current goal, each once or twice."""
        if self._left == 0:
            self._choose()
        self._left -= 1
        self.publish("/goal", PoseStamped(stamp_of(tick, RATE), self._x, self._y, self._turn))

    def _choose(self) -> None:
        noise = self._noise
        self._x, self._y = noise.between(-PATROL, PATROL), noise.between(-PATROL, PATROL)
        half_yaw = noise.between(-pi / 2, pi / 2)
        self._turn = sin(half_yaw), cos(half_yaw)
        self._left = 1 if noise.unit() < 0.5 else 2


def main() -> None:
    """Run as a process."""
    options = parse(PACED)
    from rover.bus import Bus

    with Bus(options.connect) as bus:
        operator = Operator(bus.publish, options.seed)
        bus.join(operator)
        bus.wait_for_subscriber("/goal", options.wait)
        for tick in ticks(bus, operator, RATE, options):
            operator.tick(tick)


if __name__ == "__main__":
    main()
