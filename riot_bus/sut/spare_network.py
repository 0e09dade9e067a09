"""Segments that are opened and joined while a trial waits, for the next one: that takes a sixth of a short trial."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import canonical

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["SpareNetwork"]


class _Wanted(NamedTuple):
    """The names of segments, the intercepted key expressions, and the longest wait of a publication, in seconds."""

    segments: tuple[str, ...]
    cut: tuple[str, ...]
    wait_before_close_s: float

    def network(self) -> Network:
        free = dict.fromkeys(self.segments, ("tcp/127.0.0.1:0",))
        return Network(free, wait_before_close_s=self.wait_before_close_s)


class SpareNetwork:
    """At most one open network on free ports that nobody has used yet."""

    def __init__(self) -> None:
        self._spare: tuple[_Wanted, Network] | None = None
        self._last: _Wanted | None = None

    def take(self, segments: Sequence[str], cut: Sequence[str], *, wait_before_close_s: float) -> Network:
        """Return a network of a trial's own: the spare one if it fits, else one that is not open yet.

        Args:
            segments: Names of the segments.
            cut: Key expressions that will be intercepted.
            wait_before_close_s: Longest wait of a publication for a slow receiver, in seconds.
        """
        wanted = _Wanted(tuple(segments), tuple(canonical(cut)), wait_before_close_s)
        spare, self._spare, self._last = self._spare, None, wanted
        if spare is not None and spare[0] == wanted:
            return spare[1]
        if spare is not None:
            spare[1].close()
        return wanted.network()

    def prepare(self) -> None:
        """Open another network like the one that was taken last, and begin to join its segments.

        Where that fails, there is no spare one, and the next trial tells the reason if it persists.
        """
        if self._spare is None and self._last is not None:
            network = self._last.network()
            try:
                network.begin(self._last.cut)
                self._spare = self._last, network
            except EnvironmentFaultError:
                network.close()

    def close(self) -> None:
        """Close the spare network, if there is one."""
        spare, self._spare = self._spare, None
        if spare is not None:
            spare[1].close()
