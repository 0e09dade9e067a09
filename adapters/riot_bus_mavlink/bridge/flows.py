"""What is known of frames that are alike: of one message, from one component, over one end of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.types.port import PortPublisher
    from riot_bus_mavlink.bridge.losses import SourceCount
    from riot_bus_mavlink.links.end import End

__all__ = ["MOST_FLOWS", "Flow"]

MOST_FLOWS = 4096


@dataclass(frozen=True, slots=True)
class Flow:
    """Frames that all go the same way, as long as the routes stay as they are.

    Attributes:
        extra: The message's extra byte of the checksum.
        count: Counts the frames of the source.
        others: Who gets them on the same segment.
        outlet: Puts them on the bus.
    """

    extra: bytes
    count: SourceCount
    others: Sequence[End]
    outlet: PortPublisher
