"""Where a junction and the segments meet: the Unix sockets of the links between them."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.bus import sockets

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["Meeting"]


class Meeting:
    """The links of one junction at a time.

    Args:
        connect: Endpoints of segments, to which the junction connects.
        listen: Endpoints of the junction, to which all other segments connect.
    """

    def __init__(self, connect: Sequence[str], listen: Sequence[str]) -> None:
        self.connect, self.listen = list(connect), list(listen)
        self._doors = {each.partition("/")[2] for each in connect}
        self._inner = {each.partition("/")[2] for each in listen}

    def widen(self) -> None:
        """Let the links hold several of Zenoh's full batches."""
        sockets.widen(self._doors | self._inner)

    @contextmanager
    def ended(self) -> Iterator[None]:
        """Hang up the links; until the context is left, no others are made. Then the junction has to be closed."""
        for path in self._inner:
            Path(path).unlink(missing_ok=True)
        for path in self._doors:
            Path(path).rename(_hidden(path))
        try:
            sockets.hang_up(accepted=self._inner, connected=self._doors)
            yield
        finally:
            for path in self._doors:
                _hidden(path).rename(path)


def _hidden(path: str) -> Path:
    return Path(f"{path}~")
