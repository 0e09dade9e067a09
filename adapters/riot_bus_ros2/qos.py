"""Quality of service as bags record it and as rmw_zenoh announces it.

rosbag2 writes a YAML list of the profiles of all publishers of a topic: with names (Jazzy and later) or with the
numbers of rmw (before). Only four settings matter to a publisher over Zenoh, so no YAML reader is needed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["RosQos", "parse_offered"]

_SETTING = re.compile(r"^[-\s]+(history|depth|reliability|durability):\s*(\w+)\s*$", re.MULTILINE)
_UNKNOWN_DEPTH = 10
_ALL = 1 << 16
_DEFAULT_DEPTH = 42
_MEANT = {
    ("history", "keep_all"): "keep_all",
    ("history", "2"): "keep_all",
    ("reliability", "best_effort"): "best_effort",
    ("reliability", "2"): "best_effort",
    ("durability", "transient_local"): "latched",
    ("durability", "1"): "latched",
}


@dataclass(frozen=True, slots=True)
class RosQos:
    """The quality of service of one publisher.

    Attributes:
        latched: Transient local: late joiners get the last messages.
        depth: How many messages are kept; without meaning if all are.
    """

    reliable: bool = True
    latched: bool = False
    keep_all: bool = False
    depth: int = _UNKNOWN_DEPTH

    @property
    def kept(self) -> int:
        """How many messages late joiners get of a latched publisher."""
        return _ALL if self.keep_all else self.depth

    def token(self) -> str:
        """Return the part of a liveliness token; what is rmw's default is left empty.

        Example:
            >>> RosQos(latched=True, depth=1).token()
            ':1:,1:,:,:,,'
        """
        reliability = "" if self.reliable else "2"
        durability = "1" if self.latched else ""
        history = "2" if self.keep_all else ""
        depth = "" if self.depth == _DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:{history},{depth}:,:,:,,"


def parse_offered(text: str) -> RosQos:
    """Return one profile that serves the subscribers of all recorded ones; of nothing, rmw's usual one.

    One publisher stands for all that were recorded, so it keeps the last messages of all of them.

    Args:
        text: `offered_qos_profiles` of a bag's channel.
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
    )


def _depth(profile: dict[str, str]) -> int:
    text = profile.get("depth", "")
    known = text.isdecimal() and len(text) < 10 and int(text) > 0
    return int(text) if known else _UNKNOWN_DEPTH
