"""What is known of frames that are alike: of one message, from one component, over one end of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus_mavlink.bridge.losses import SourceCount
    from riot_bus_mavlink.links.end import End

__all__ = ["KIND", "MOST_FLOWS", "Flow"]

KIND = slice(5, 10)
"""Where frames of MAVLink 2 have their system, component and message."""
MOST_FLOWS = 4096


@dataclass(frozen=True, slots=True)
class Flow:
    """Frames that all go the same way, as long as nothing changes.

    Attributes:
        generation: Of the routes, when it was found.
        extra: The message's extra byte of the checksum.
        count: Counts the frames of the source.
        others: Who gets them on the same segment.
        put: Puts one on the bus, with an attachment.
    """

    generation: int
    extra: int
    count: SourceCount
    others: Sequence[End]
    put: Callable[[bytes, bytes], None]
