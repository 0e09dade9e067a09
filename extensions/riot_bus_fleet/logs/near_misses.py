"""How near logs came to a rule: what a scan has found, in words and as JSON; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.message import Scalar

BINS = 120
"""Number of intervals of a log in a plot of its distance."""
_TOLD = 10
"""Number of logs that are named among those that were not judged for the same reason."""


@dataclass(frozen=True, slots=True)
class NearMiss:
    """A moment of a log: its distance from the rule, when it was (ns), and the fields of the rule."""

    distance: float
    time: int
    values: Mapping[str, Scalar]

    def words(self, start: int) -> str:
        """Return the moment for people, with the seconds since the beginning of the log."""
        return f"{(self.time - start) / 1e9:.3f} s, {self.far}: {self.told}"

    @property
    def far(self) -> str:
        """The distance in words."""
        # For what cannot be measured, such as a text in place of a number.
        return "holds" if self.distance <= 0 else f"{self.distance:.3g} away" if self.distance < 1e17 else "far away"

    @property
    def told(self) -> str:
        """The fields and their values."""
        return ", ".join(f"{name} = {value!r}" for name, value in self.values.items())


@dataclass(frozen=True, slots=True)
class LogScan:
    """Result of scanning one log for a rule.

    Attributes:
        judged: Messages of the rule's topics at which all of its fields were known.
        unknown: Messages of the last of its topics at which a field was not known.
        nearest: The moments of least distance, nearest first, at least a second apart.
        profile: Least distance in each of `BINS` equal stretches of the log; NaN where nothing was judged.
        problem: Reason why it was not judged, or not all of it; empty if it was.
    """

    place: str
    robot: str = ""
    judged: int = 0
    unknown: int = 0
    holds: int = 0
    nearest: tuple[NearMiss, ...] = ()
    start: int = 0
    profile: tuple[float, ...] = ()
    problem: str = ""

    @property
    def distance(self) -> float:
        """The least distance; infinite where nothing was judged."""
        return self.nearest[0].distance if self.nearest else float("inf")

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        moments = [
            {
                "distance": one.distance,
                "time": one.time,
                "seconds": (one.time - self.start) / 1e9,
                "values": {
                    name: value.hex() if isinstance(value, bytes) else value for name, value in one.values.items()
                },
            }
            for one in self.nearest
        ]
        figures = {"judged": self.judged, "unknown": self.unknown, "holds": self.holds}
        return {"log": self.place, "robot": self.robot, **figures, "nearest": moments, "problem": self.problem}


@dataclass(frozen=True, slots=True)
class FleetScan:
    """Result of scanning a fleet's logs for a rule.

    Attributes:
        within: Distance below which a moment is a near miss, in nominal spreads.
        logs: All logs, nearest first; equally near ones stay in the given order.
    """

    rule: str
    within: float
    logs: tuple[LogScan, ...]

    @property
    def failing(self) -> tuple[LogScan, ...]:
        """Logs in which the rule holds somewhere."""
        return tuple(log for log in self.logs if log.holds)

    @property
    def near(self) -> tuple[LogScan, ...]:
        """Logs in which the rule comes near but does not hold."""
        return tuple(log for log in self.logs if not log.holds and log.distance < self.within)

    @property
    def unjudged(self) -> tuple[LogScan, ...]:
        """Logs without any judged message."""
        return tuple(log for log in self.logs if not log.judged)

    @property
    def robots(self) -> list[tuple[str, list[LogScan]]]:
        """The judged logs of each robot, the one that came nearest first."""
        judged = [log for log in self.logs if log.judged]
        first = {robot: number for number, robot in reversed([(n, log.robot) for n, log in enumerate(judged)])}
        judged.sort(key=lambda log: first[log.robot])
        return [(robot, list(logs)) for robot, logs in groupby(judged, lambda log: log.robot)]

    def summary(self) -> str:
        """Return how many logs came how near, in one sentence."""
        far = len(self.logs) - len(self.failing) - len(self.near) - len(self.unjudged)
        met = f"{len(self.failing)} meet" if len(self.failing) > 1 else f"{len(self.failing) or 'none'} meets"
        misses = "near miss" if len(self.near) == 1 else "near misses"
        partly = sum(bool(log.judged and log.problem) and not log.holds for log in self.logs)
        reach = f"; {counted(partly, 'log')} only as far as {'it' if partly == 1 else 'they'} could be read"
        spreads = f"{self.within:g} nominal spread{'' if self.within == 1 else 's'} of its fields"
        return (
            f"{counted(len(self.logs), 'log')}: {met} the rule, {len(self.near)} {misses} (nearer than {spreads}), "
            f"{far} farther away, {len(self.unjudged)} not judged{reach if partly else ''}"
        )

    def lines(self) -> list[str]:
        """Return the result as lines for people."""
        found = [f"rule: {self.rule}", self.summary()]
        for robot, logs in self.robots:
            found += ["", f"robot {robot or '(not named)'}"]
            for log in logs:
                held = f"holds at {log.holds} of" if log.holds else "holds at none of"
                more = f"; {log.unknown} lack a field of it" if log.unknown else ""
                found.append(f"  {log.place}: {held} {counted(log.judged, 'message')}{more}")
                found += [f"    ({log.problem})"] if log.problem else []
                found += [f"    {one.words(log.start)}" for one in log.nearest]
        found += ["", "not judged"] if self.unjudged else []
        why: dict[str, list[str]] = {}
        for log in self.unjudged:
            why.setdefault(log.problem, []).append(log.place)
        for problem, places in why.items():
            found += [f"  {problem}: {counted(len(places), 'log')}", *(f"    {place}" for place in places[:_TOLD])]
            found += [f"    ... and {len(places) - _TOLD} more"] if len(places) > _TOLD else []
        return found

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        return {"rule": self.rule, "within": self.within, "logs": [log.to_json() for log in self.logs]}
