"""The outside world: the rover's body and its sensors."""

from __future__ import annotations

from math import cos, radians, sin

from rover.clock import stamp_of, ticks
from rover.component import Component
from rover.noise import Noise
from rover.options import PACED, parse
from rover.sensors import BatteryState, Imu, Joy, NavSatFix, Odometry
from rover.world import Body

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.component import Publish
    from rover.messages import Stamp, Twist

RATE = 25
SLOW = 5
GRAVITY = 9.81
HOME_LATITUDE, HOME_LONGITUDE, HOME_ALTITUDE = 40.4433, -79.9436, 280.0
METRES_PER_DEGREE = 111_320.0


class Sim(Component):
    """Drives as commanded and measures, with noise, what a rover's sensors measure."""

    NAME = "sim"
    INPUTS = ("/cmd_vel",)
    OUTPUTS = ("/odom", "/imu", "/gps/fix", "/battery_state", "/joy")

    def __init__(self, publish: Publish, seed: int) -> None:
        super().__init__(publish)
        self.body = Body()
        self._noise = Noise(seed)
        self._charge = BatteryState.CAPACITY * self._noise.between(0.7, 0.95)
        self._warmth = 24.0
        self._sticks = [0.0] * 4

    def on_cmd_vel(self, twist: Twist) -> None:
        """Pass a command to the wheels."""
        self.body.command(twist)

    def tick(self, tick: int) -> None:
        """Let a 25th of a second pass."""
        self.body.step(1 / RATE)
        stamp = stamp_of(tick, RATE)
        self._measure_motion(stamp, tick / RATE)
        if tick % SLOW == 0:
            self._measure_place(stamp)
            self._read_sticks(stamp)
        if tick % RATE in (0, RATE // 2):
            self._measure_battery(stamp)

    def _measure_motion(self, stamp: Stamp, time: float) -> None:
        body, normal = self.body, self._noise.normal
        place = body.x + normal(0.02), body.y + normal(0.02)
        self.publish("/odom", Odometry(stamp, *place, body.vx + normal(0.05), body.vy + normal(0.05)))
        rumble = 0.02 * sin(7.0 * time)
        rates = normal(0.01) + rumble, normal(0.01) - rumble, normal(0.005)
        acceleration = body.ax + normal(0.08), body.ay + normal(0.08), GRAVITY + normal(0.08)
        self.publish("/imu", Imu(stamp, rates, acceleration))

    def _measure_place(self, stamp: Stamp) -> None:
        body, normal = self.body, self._noise.normal
        latitude = HOME_LATITUDE + (body.y + normal(1.5)) / METRES_PER_DEGREE
        scale = METRES_PER_DEGREE * cos(radians(HOME_LATITUDE))
        longitude = HOME_LONGITUDE + (body.x + normal(1.5)) / scale
        self.publish("/gps/fix", NavSatFix(stamp, (latitude, longitude, HOME_ALTITUDE + normal(3.0))))

    def _read_sticks(self, stamp: Stamp) -> None:
        self._sticks = [0.9 * stick + self._noise.normal(0.004) for stick in self._sticks]
        self.publish("/joy", Joy(stamp, self._sticks, [0] * 8))

    def _measure_battery(self, stamp: Stamp) -> None:
        normal = self._noise.normal
        drawn = 2.0 + 3.0 * (abs(self.body.vx) + abs(self.body.vy)) + abs(normal(0.2))
        self._charge = max(0.0, self._charge - drawn * 0.5 / 3600.0)
        self._warmth += 0.01 * drawn - 0.002 * (self._warmth - 20.0)
        voltage = 21.0 + 4.0 * self._charge / BatteryState.CAPACITY - 0.02 * drawn + normal(0.01)
        self.publish("/battery_state", BatteryState(stamp, voltage, -drawn, self._charge, self._warmth + normal(0.1)))


def main() -> None:
    """Run as a process."""
    options = parse(PACED)
    from rover.bus import Bus

    with Bus(options.connect) as bus:
        sim = Sim(bus.publish, options.seed)
        bus.join(sim)
        bus.wait_for_subscriber("/odom", options.wait)
        for tick in ticks(bus, sim, RATE, options):
            sim.tick(tick)


if __name__ == "__main__":
    main()
