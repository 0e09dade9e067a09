"""Known routes of similar frames: the same message, from the same component, over the same end of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.types.port import PortPublisher
    from riot_bus_mavlink.bridge.losses import SourceCount
    from riot_bus_mavlink.links.end import End

__all__ = ["MOST_FLOWS", "Flow"]

MOST_FLOWS = 4096  # senders choose their ids: bounds memory; beyond it all routes are found anew


@dataclass(frozen=True, slots=True)
class Flow:
    """Frames that all take the same route, as long as the routing table does not change.

    Attributes:
        extra: The message's CRC extra byte.
        count: Counter of the frames of the source.
        others: Other ends on the same segment that get the frames.
        outlet: Publisher that puts the frames on the bus.
    """

    extra: bytes
    count: SourceCount
    others: Sequence[End]
    outlet: PortPublisher
