"""The Unix sockets of the links between a junction and the segments."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from riot_bus.zenoh import sockets


class JunctionSockets:
    """The links of one junction at a time.

    Args:
        connect: Endpoints of segments, to which the junction connects.
        listen: Endpoints of the junction, to which all other segments connect.
    """

    def __init__(self, connect: Sequence[str], listen: Sequence[str]) -> None:
        self.connect, self.listen = list(connect), list(listen)
        self._doors = {each.partition("/")[2] for each in connect}
        self._inner = {each.partition("/")[2] for each in listen}
        self._hidden: dict[Path, Path] = {}

    def widen(self) -> None:
        """Let the links hold several of Zenoh's full batches."""
        sockets.widen(self._doors | self._inner)

    def end(self) -> None:
        """Close the links and prevent new ones; afterwards, the junction has to be closed and `reopen` called."""
        for path in map(Path, self._inner):
            path.unlink(missing_ok=True)
        for path in map(Path, self._doors):
            with suppress(FileNotFoundError):  # the file was removed from outside
                self._hidden[path] = path.rename(f"{path}~")
        sockets.hang_up(accepted=self._inner, connected=self._doors)

    def reopen(self) -> None:
        """Let the next junction connect."""
        while self._hidden:
            path, hidden = self._hidden.popitem()
            with suppress(FileNotFoundError):
                hidden.rename(path)
