"""Quality of service as eight numbers of rmw: reliability, durability, history, depth, deadline, lifespan,
liveliness, lease. Durations are nanoseconds, 0 if infinite.
"""  # noqa: D205

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

if TYPE_CHECKING:
    from collections.abc import Sequence

_ENDLESS_NS = 2_147_483_647 * 10**9  # infinity in DDS; that of rmw is longer


def profile_of(numbers: Sequence[int]) -> QoSProfile:
    """Return a profile for rclpy."""
    reliability, durability, history, depth, deadline, lifespan, liveliness, lease = numbers
    durations = {"deadline": deadline, "lifespan": lifespan, "liveliness_lease_duration": lease}
    return QoSProfile(
        reliability=ReliabilityPolicy(reliability),
        durability=DurabilityPolicy(durability),
        history=HistoryPolicy(history),
        depth=depth,
        liveliness=LivelinessPolicy(liveliness),
        **{name: Duration(nanoseconds=value) for name, value in durations.items() if value},
    )


def numbers_of(profile: Any) -> list[int]:
    """Return rclpy's profile of an endpoint; history and depth are 0 (unknown) if DDS does not tell them."""
    return [
        int(profile.reliability),
        int(profile.durability),
        int(profile.history),
        int(profile.depth),
        _duration(profile.deadline),
        _duration(profile.lifespan),
        int(profile.liveliness),
        _duration(profile.liveliness_lease_duration),
    ]


def _duration(duration: Any) -> int:
    found = int(duration.nanoseconds)
    return 0 if found >= _ENDLESS_NS else found
