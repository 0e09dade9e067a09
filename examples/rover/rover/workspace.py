"""The planner's memory: allocated once, so that planning never has to ask for more."""

from __future__ import annotations

import ctypes

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.maps import OccupancyGridUpdate

WORKSPACE = 4_194_304


class Window:
    """The cells that an update is worked on in."""

    def __init__(self, cells: ctypes.Array[ctypes.c_int8]) -> None:
        self._cells = cells

    def place(self, data: bytes) -> int:
        """Lay an update's cells into the window, and count the free ones."""
        size = min(len(self._cells), len(data))
        ctypes.memmove(self._cells, data, size)
        return data.count(0, 0, size)


class Workspace:
    """A fixed block of cells, of which the working window takes the front part."""

    def __init__(self) -> None:
        self._cells = bytearray(WORKSPACE)

    def window(self, update: OccupancyGridUpdate) -> Window:
        """Make room for an update."""
        return Window((ctypes.c_int8 * (update.x * update.y)).from_buffer(self._cells))
