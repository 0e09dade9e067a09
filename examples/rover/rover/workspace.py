"""The planner's memory: allocated once, so that planning never has to ask for more."""

from __future__ import annotations

import ctypes

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.maps import OccupancyGridUpdate

WORKSPACE = 4_194_304


class Workspace:
    """A fixed block of cells, of which the working window takes the front part."""

    def __init__(self) -> None:
        self._cells = bytearray(WORKSPACE)

    def place(self, update: OccupancyGridUpdate) -> int:
        """Lay an update into the working window, and count its free cells."""
        window = (ctypes.c_int8 * (update.x * update.y)).from_buffer(self._cells)
        size = min(len(window), len(update.data))
        ctypes.memmove(window, update.data, size)
        return update.data.count(0, 0, size)
