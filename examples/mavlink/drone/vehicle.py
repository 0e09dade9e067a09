"""The drone itself: where it is, what it does, and how it moves. No messages, no clock of its own."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from enum import IntEnum
from math import atan2, cos, degrees, hypot, radians

METRES_PER_DEGREE = 111_320.0
HOME = 47.397742, 8.545594, 488.0
SPEED = 8.0
CLIMB = 3.0
NEAR = 1.0
ENDURANCE = 900.0
VOLTS = 12.6, 9.9


class Mode(IntEnum):
    """Flight modes, with ArduCopter's numbers."""

    STABILIZE = 0
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9


@dataclass(slots=True)
class Place:
    """Degrees, and metres above home."""

    latitude: float
    longitude: float
    height: float = 0.0


@dataclass(slots=True)
class Vehicle:
    """A drone that flies straight at its target and wobbles a little.

    Attributes:
        seed: Seed of its noise.
        route: Items of the mission: places, modes to enter, and None for what is neither.
        target: Where it is going.
        current: Item of the mission that it is flying to.
        reached: Item that it has just reached.
        time: Seconds since it was switched on.
        battery: What is left, 1 to 0.
        north, east, up: Metres per second.
    """

    seed: int = 1
    mode: Mode = Mode.STABILIZE
    armed: bool = False
    home: Place = field(default_factory=lambda: Place(HOME[0], HOME[1]))
    place: Place = field(default_factory=lambda: Place(HOME[0], HOME[1]))
    target: Place | None = None
    route: list[Place | Mode | None] = field(default_factory=list)
    current: int = 0
    reached: int | None = None
    time: float = 0.0
    battery: float = 1.0
    north: float = 0.0
    east: float = 0.0
    up: float = 0.0
    yaw: float = 0.0
    noise: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self.noise = random.Random(self.seed)

    @property
    def flying(self) -> bool:
        """Whether it is off the ground."""
        return self.place.height > 0.2

    @property
    def speed(self) -> float:
        """Metres per second over ground."""
        return hypot(self.north, self.east)

    @property
    def voltage(self) -> float:
        """Of the whole battery."""
        full, empty = VOLTS
        return empty + (full - empty) * self.battery + self.noise.gauss(0, 0.01)

    def enter(self, mode: Mode) -> None:
        """Change the mode; what it was going to is forgotten, but for a mission."""
        self.mode = mode
        if mode is Mode.RTL:
            self.target = Place(self.home.latitude, self.home.longitude, max(self.place.height, 15.0))
        elif mode is Mode.LAND:
            self.target = Place(self.place.latitude, self.place.longitude, 0.0)
        elif mode is Mode.AUTO:
            self.select(self.current)
        else:
            self.target = None

    def select(self, item: int) -> None:
        """Fly to an item of the mission next."""
        self.current = item
        if self.mode is Mode.AUTO:
            found = self.route[item] if item < len(self.route) else None
            if isinstance(found, Mode):
                self.enter(found)
            else:
                self.target = found

    def step(self, seconds: float) -> None:
        """Let time pass."""
        self.time += seconds
        self.battery = max(0.0, self.battery - seconds / ENDURANCE * (1.0 if self.armed else 0.1))
        if self.mode is Mode.AUTO and self.target is None and self.current < len(self.route):
            self.select(self.current + 1)  # not a place: nothing to fly to
        if not self.armed or self.target is None:
            self.north = self.east = self.up = 0.0
            return
        if self._approach(self.target, seconds):
            self._arrive()

    def _approach(self, target: Place, seconds: float) -> bool:
        scale = METRES_PER_DEGREE * cos(radians(self.home.latitude))
        north = (target.latitude - self.place.latitude) * METRES_PER_DEGREE
        east = (target.longitude - self.place.longitude) * scale
        up = target.height - self.place.height
        distance = hypot(north, east)
        speed = min(SPEED, distance / seconds)
        self.north, self.east = (speed * north / distance, speed * east / distance) if distance else (0.0, 0.0)
        self.up = max(-CLIMB, min(CLIMB, up / seconds))
        if speed > NEAR:
            self.yaw = atan2(east, north)
        self.place.latitude += self.north * seconds / METRES_PER_DEGREE
        self.place.longitude += self.east * seconds / scale
        self.place.height = max(0.0, self.place.height + self.up * seconds)
        return distance < NEAR and abs(up) < NEAR / 2

    def _arrive(self) -> None:
        if self.mode is Mode.AUTO:
            self.reached = self.current
            self.select(self.current + 1)
        elif self.mode is Mode.RTL:
            self.enter(Mode.LAND)
        elif self.mode is Mode.LAND and not self.flying:
            self.armed = False
            self.target = None

    def metres_to(self, place: Place) -> float:
        """Return how far a place is over ground."""
        scale = METRES_PER_DEGREE * cos(radians(self.home.latitude))
        north = (place.latitude - self.place.latitude) * METRES_PER_DEGREE
        return hypot(north, (place.longitude - self.place.longitude) * scale)

    @property
    def heading(self) -> float:
        """Degrees, 0 to 360, clockwise from north."""
        return degrees(self.yaw) % 360
