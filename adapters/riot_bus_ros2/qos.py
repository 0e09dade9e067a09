"""Quality of service (QoS) of ROS endpoints, as rmw_zenoh announces it and as bags record it.

rosbag2 writes a YAML list of the profiles of all publishers of a topic: with names (Jazzy and later) or with the
numbers of rmw (before). Reading it line by line is enough here, so no YAML parser is needed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Self

Duration = tuple[int, int]
"""Seconds and nanoseconds."""

Reliability = IntEnum("Reliability", "RELIABLE BEST_EFFORT")  # rmw's numbers, as below
Durability = IntEnum("Durability", "LATCHED VOLATILE")
HistoryPolicy = IntEnum("HistoryPolicy", "KEEP_LAST KEEP_ALL")
Liveliness = IntEnum("Liveliness", {"AUTOMATIC": 1, "BY_TOPIC": 3})  # 2 (by node) is deprecated
FOREVER: Duration = (9223372036, 854775807)
"""What rmw takes for an infinite duration."""
USUAL_DEPTH = 10
"""Depth of rmw's default profile, also for bags and tokens of which the depth is not known."""

_SETTING = re.compile(r"^[-\s]+(history|depth|reliability|durability|liveliness):\s*(\w+)\s*$", re.MULTILINE)
_DURATION = re.compile(
    r"^[-\s]+(deadline|lifespan|liveliness_lease_duration):\s+sec:\s*(\d{1,20})\s+nsec:\s*(\d{1,10})\s*$", re.MULTILINE
)
_ENDLESS_S = 2_147_483_647  # infinity in DDS, found in some bags
_ALL = 1 << 16  # a guess: bounds memory, since bags and "keep all" set no limit
_DEFAULT_DEPTH = 42  # RMW_ZENOH_DEFAULT_HISTORY_DEPTH in rmw_zenoh's qos.cpp, left out in tokens
_SECOND = 10**9  # nanoseconds
_MEANT = {
    ("history", "keep_all"): "keep_all",
    ("history", "2"): "keep_all",
    ("reliability", "best_effort"): "best_effort",
    ("reliability", "2"): "best_effort",
    ("durability", "transient_local"): "latched",
    ("durability", "1"): "latched",
    ("liveliness", "manual_by_topic"): "by_topic",
    ("liveliness", "3"): "by_topic",
}
_NUMBER = re.compile(r"[0-9]{1,10}", re.ASCII)


@dataclass(frozen=True, slots=True)
class RosQos:
    """All settings of an endpoint, with rmw's numbers; the defaults are those of rmw_zenoh. Source: its qos.cpp.

    Attributes:
        reliability: 1 reliable, 2 best effort.
        durability: 1 transient local ("latched": late joiners get the last messages), 2 volatile.
        history: 1 keep last, 2 keep all.
        depth: Depth of the history, 0 if it is not known, as in DDS.
        deadline: Longest time between two messages.
        lifespan: Age beyond which messages are not delivered.
        liveliness: 1 automatic, 3 manual by topic (only publishing shows that the publisher is alive).
        lease: Longest silence after which a publisher still counts as alive.
    """

    reliability: int = Reliability.RELIABLE
    durability: int = Durability.VOLATILE
    history: int = HistoryPolicy.KEEP_LAST
    depth: int = _DEFAULT_DEPTH
    deadline: Duration = FOREVER
    lifespan: Duration = FOREVER
    liveliness: int = Liveliness.AUTOMATIC
    lease: Duration = FOREVER

    @property
    def reliable(self) -> bool:
        """Whether lost messages are sent again."""
        return self.reliability == Reliability.RELIABLE

    @property
    def latched(self) -> bool:
        """Whether late joiners get the last messages (transient local)."""
        return self.durability == Durability.LATCHED

    @property
    def keep_all(self) -> bool:
        """Whether all messages are kept, whatever the depth."""
        return self.history == HistoryPolicy.KEEP_ALL

    @property
    def kept(self) -> int:
        """Number of messages that a latched publisher keeps for late joiners."""
        return _ALL if self.keep_all else self.depth

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse the last chunk of a token; parts that are empty, missing or not numbers get rmw_zenoh's default.

        Args:
            text: `reliability:durability:history,depth:deadline:lifespan:liveliness,lease`, durations as `s,ns`.

        Example:
            >>> RosQos.parse(":1:,10:,:,:,,").durability
            1
        """
        parts = (text.split(":") + [""] * len(_DEFAULTS))[: len(_DEFAULTS)]
        reliability, durability, history, depth, *durations, liveliness, lease_s, lease_ns = (
            number for part, defaults in zip(parts, _DEFAULTS, strict=True) for number in _numbers(part, defaults)
        )
        deadline, lifespan = (durations[0], durations[1]), (durations[2], durations[3])
        return cls(reliability, durability, history, depth, deadline, lifespan, liveliness, (lease_s, lease_ns))

    @classmethod
    def of_numbers(cls, numbers: Sequence[int]) -> Self:
        """Return the QoS that `numbers` describes; numbers of rmw for "unknown" become the weaker setting."""
        reliability, durability, history, depth, deadline, lifespan, liveliness, lease = numbers
        return cls(
            Reliability.RELIABLE if reliability == Reliability.RELIABLE else Reliability.BEST_EFFORT,
            Durability.LATCHED if durability == Durability.LATCHED else Durability.VOLATILE,
            HistoryPolicy.KEEP_ALL if history == HistoryPolicy.KEEP_ALL else HistoryPolicy.KEEP_LAST,
            depth,
            divmod(deadline, _SECOND) if deadline else FOREVER,
            divmod(lifespan, _SECOND) if lifespan else FOREVER,
            Liveliness.BY_TOPIC if liveliness == Liveliness.BY_TOPIC else Liveliness.AUTOMATIC,
            divmod(lease, _SECOND) if lease else FOREVER,
        )

    def numbers(self) -> list[int]:
        """Return the settings as the node of a bridge takes them: in this order, durations in ns, 0 if infinite."""
        deadline, lifespan, lease = (
            0 if each >= FOREVER else each[0] * _SECOND + each[1] for each in (self.deadline, self.lifespan, self.lease)
        )
        settings = [self.reliability, self.durability, self.history, self.depth]
        return [*settings, deadline, lifespan, self.liveliness, lease]

    def token(self) -> str:
        """Return the chunk of a token; values that equal rmw_zenoh's default are left empty.

        Example:
            >>> RosQos(durability=1, depth=1).token()
            ':1:,1:,:,:,,'
        """
        return ":".join(
            ",".join("" if value == default else str(value) for value, default in zip(group, defaults, strict=True))
            for group, defaults in zip(self.groups(), _DEFAULTS, strict=True)
        )

    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Return the parts of `token`."""
        history, liveliness = (self.history, self.depth), (self.liveliness, *self.lease)
        return (self.reliability,), (self.durability,), history, self.deadline, self.lifespan, liveliness

    def profile(self) -> str:
        """Return the profile as rosbag2 writes it: YAML, with rmw's numbers."""
        lines = [
            f"- history: {self.history}",
            f"  depth: {self.depth}",
            f"  reliability: {self.reliability}",
            f"  durability: {self.durability}",
            *_duration("deadline", self.deadline),
            *_duration("lifespan", self.lifespan),
            f"  liveliness: {self.liveliness}",
            *_duration("liveliness_lease_duration", self.lease),
            "  avoid_ros_namespace_conventions: false",
        ]
        return "\n".join(lines) + "\n"


_DEFAULTS = RosQos().groups()


def _numbers(text: str, defaults: tuple[int, ...]) -> list[int]:
    found = text.split(",")[: len(defaults)] + [""] * len(defaults)
    return [int(part) if _NUMBER.fullmatch(part) else default for part, default in zip(found, defaults, strict=False)]


def _duration(name: str, duration: Duration) -> list[str]:
    seconds, nanoseconds = duration
    return [f"  {name}:", f"    sec: {seconds}", f"    nsec: {nanoseconds}"]


def parse_offered(text: str) -> RosQos:
    """Return one profile that suits the subscribers of all recorded publishers; for empty text, rmw's default.

    One publisher replaces all recorded ones, so it keeps the last messages of all of them.
    """
    profiles: list[dict[str, str]] = []
    for name, value in _SETTING.findall(text):
        if not profiles or name in profiles[-1]:
            profiles.append({})
        profiles[-1][name] = value.lower()
    if not profiles:
        return RosQos(depth=USUAL_DEPTH)
    meant = [{_MEANT.get(setting) for setting in each.items()} for each in profiles]
    latched = [each for each, means in zip(profiles, meant, strict=True) if "latched" in means]
    depths = [_depth(each) for each in latched or profiles]
    return RosQos(
        reliability=Reliability.BEST_EFFORT if all("best_effort" in each for each in meant) else Reliability.RELIABLE,
        durability=Durability.LATCHED if latched else Durability.VOLATILE,
        history=HistoryPolicy.KEEP_ALL if any("keep_all" in each for each in meant) else HistoryPolicy.KEEP_LAST,
        depth=min(_ALL, sum(depths) if latched else max(depths)),
        deadline=min(_durations(text, "deadline")),
        lifespan=max(_durations(text, "lifespan")),
        liveliness=Liveliness.BY_TOPIC if any("by_topic" in each for each in meant) else Liveliness.AUTOMATIC,
        lease=min(_durations(text, "liveliness_lease_duration")),
    )


def _durations(text: str, name: str) -> list[Duration]:
    found = [(int(seconds), int(rest)) for each, seconds, rest in _DURATION.findall(text) if each == name]
    return [each if (0, 0) < each < (_ENDLESS_S, 0) else FOREVER for each in found] or [FOREVER]


def _depth(profile: dict[str, str]) -> int:
    text = profile.get("depth", "")
    known = text.isdecimal() and len(text) < 10 and int(text) > 0
    return int(text) if known else USUAL_DEPTH
