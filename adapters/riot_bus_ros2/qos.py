"""Quality of service as bags record it and as rmw_zenoh announces it.

rosbag2 writes a YAML list of the profiles of all publishers of a topic: with names (Jazzy and later) or with the
numbers of rmw (before). Reading it line by line is enough here, so no YAML parser is needed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

__all__ = ["FOREVER", "AnnouncedQos", "RosQos", "parse_offered"]

_SETTING = re.compile(r"^[-\s]+(history|depth|reliability|durability|liveliness):\s*(\w+)\s*$", re.MULTILINE)
_DURATION = re.compile(
    r"^[-\s]+(deadline|lifespan|liveliness_lease_duration):\s+sec:\s*(\d{1,20})\s+nsec:\s*(\d{1,10})\s*$", re.MULTILINE
)
_ENDLESS_S = 2_147_483_647  # infinity in DDS, found in some bags
_UNKNOWN_DEPTH = 10  # rmw's default, also for bags that tell no depth
_ALL = 1 << 16  # a guess: bounds memory, since bags and "keep all" set no limit
_DEFAULT_DEPTH = 42  # RMW_ZENOH_DEFAULT_HISTORY_DEPTH in rmw_zenoh's qos.cpp, left out in tokens
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

FOREVER = (9223372036, 854775807)
"""Seconds and nanoseconds that rmw takes for an infinite duration."""

_DEFAULTS = ((1,), (2,), (1, _DEFAULT_DEPTH), FOREVER, FOREVER, (1, *FOREVER))
_NUMBER = re.compile(r"[0-9]{1,10}", re.ASCII)


@dataclass(frozen=True, slots=True)
class AnnouncedQos:
    """All settings of an endpoint as rmw_zenoh announces them, with rmw's numbers. Source: its qos.cpp.

    Attributes:
        reliability: 1 reliable, 2 best effort.
        durability: 1 transient local, 2 volatile.
        history: 1 keep last, 2 keep all.
        depth: Depth of the history.
        deadline: Longest time between two messages, in seconds and nanoseconds.
        lifespan: Lifespan of messages, in seconds and nanoseconds.
        liveliness: 1 automatic, 3 manual by topic.
        lease: Lease duration of the liveliness, in seconds and nanoseconds.
    """

    reliability: int = 1
    durability: int = 2
    history: int = 1
    depth: int = _DEFAULT_DEPTH
    deadline: tuple[int, int] = FOREVER
    lifespan: tuple[int, int] = FOREVER
    liveliness: int = 1
    lease: tuple[int, int] = FOREVER

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse the last chunk of a token; parts that are empty, missing or not numbers get rmw_zenoh's default.

        Args:
            text: `reliability:durability:history,depth:deadline:lifespan:liveliness,lease`, durations as `s,ns`.

        Example:
            >>> AnnouncedQos.parse(":1:,10:,:,:,,").durability
            1
        """
        parts = (text.split(":") + [""] * len(_DEFAULTS))[: len(_DEFAULTS)]
        (reliability,), (durability,), (history, depth), deadline, lifespan, (liveliness, *lease) = (
            _numbers(part, defaults) for part, defaults in zip(parts, _DEFAULTS, strict=True)
        )
        return cls(
            reliability,
            durability,
            history,
            depth,
            (deadline[0], deadline[1]),
            (lifespan[0], lifespan[1]),
            liveliness,
            (lease[0], lease[1]),
        )

    def token(self) -> str:
        """Return the chunk of a token; values that equal rmw_zenoh's default are left empty.

        Example:
            >>> AnnouncedQos(durability=1, depth=1).token()
            ':1:,1:,:,:,,'
        """
        groups = (
            (self.reliability,),
            (self.durability,),
            (self.history, self.depth),
            self.deadline,
            self.lifespan,
            (self.liveliness, *self.lease),
        )
        return ":".join(
            ",".join("" if value == default else str(value) for value, default in zip(group, defaults, strict=True))
            for group, defaults in zip(groups, _DEFAULTS, strict=True)
        )

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


def _numbers(text: str, defaults: tuple[int, ...]) -> list[int]:
    found = text.split(",")[: len(defaults)] + [""] * len(defaults)
    return [int(part) if _NUMBER.fullmatch(part) else default for part, default in zip(found, defaults, strict=False)]


def _duration(name: str, duration: tuple[int, int]) -> list[str]:
    seconds, nanoseconds = duration
    return [f"  {name}:", f"    sec: {seconds}", f"    nsec: {nanoseconds}"]


@dataclass(frozen=True, slots=True)
class RosQos:
    """The quality of service of one publisher.

    Attributes:
        latched: Whether late joiners get the last messages (transient local).
        depth: Number of messages that are kept; meaningless if all are.
        deadline: Longest time between two messages, in seconds and nanoseconds.
        lifespan: Time for which messages are useful.
        by_topic: Whether only publishing shows that the publisher is alive.
        lease: Time for which it then counts as alive.
    """

    reliable: bool = True
    latched: bool = False
    keep_all: bool = False
    depth: int = _UNKNOWN_DEPTH
    deadline: tuple[int, int] = FOREVER
    lifespan: tuple[int, int] = FOREVER
    by_topic: bool = False
    lease: tuple[int, int] = FOREVER

    @property
    def kept(self) -> int:
        """Number of messages that a latched publisher keeps for late joiners."""
        return _ALL if self.keep_all else self.depth

    @property
    def announced(self) -> AnnouncedQos:
        """The same QoS in the form that rmw_zenoh announces."""
        return AnnouncedQos(
            reliability=1 if self.reliable else 2,
            durability=1 if self.latched else 2,
            history=2 if self.keep_all else 1,
            depth=self.depth,
            deadline=self.deadline,
            lifespan=self.lifespan,
            liveliness=3 if self.by_topic else 1,
            lease=self.lease,
        )

    def token(self) -> str:
        """Return the part of a liveliness token; values that equal rmw's default are left empty.

        Example:
            >>> RosQos(latched=True, depth=1).token()
            ':1:,1:,:,:,,'
        """
        return self.announced.token()


def parse_offered(text: str) -> RosQos:
    """Return one profile that suits the subscribers of all recorded publishers; for empty text, rmw's default.

    One publisher replaces all recorded ones, so it keeps the last messages of all of them.

    Args:
        text: Value of `offered_qos_profiles` of a bag's channel.
    """
    profiles: list[dict[str, str]] = []
    for name, value in _SETTING.findall(text):
        if not profiles or name in profiles[-1]:
            profiles.append({})
        profiles[-1][name] = value.lower()
    if not profiles:
        return RosQos()
    meant = [{_MEANT.get(setting) for setting in each.items()} for each in profiles]
    latched = [each for each, means in zip(profiles, meant, strict=True) if "latched" in means]
    depths = [_depth(each) for each in latched or profiles]
    return RosQos(
        reliable=not all("best_effort" in each for each in meant),
        latched=bool(latched),
        keep_all=any("keep_all" in each for each in meant),
        depth=min(_ALL, sum(depths) if latched else max(depths)),
        deadline=min(_durations(text, "deadline")),
        lifespan=max(_durations(text, "lifespan")),
        by_topic=any("by_topic" in each for each in meant),
        lease=min(_durations(text, "liveliness_lease_duration")),
    )


def _durations(text: str, name: str) -> list[tuple[int, int]]:
    found = [(int(seconds), int(rest)) for each, seconds, rest in _DURATION.findall(text) if each == name]
    return [each if (0, 0) < each < (_ENDLESS_S, 0) else FOREVER for each in found] or [FOREVER]


def _depth(profile: dict[str, str]) -> int:
    text = profile.get("depth", "")
    known = text.isdecimal() and len(text) < 10 and int(text) > 0
    return int(text) if known else _UNKNOWN_DEPTH
