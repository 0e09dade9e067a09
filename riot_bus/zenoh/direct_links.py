"""Direct links between segments: what is not intercepted passes two routers, not three, while the first cut holds."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from riot_bus.zenoh.session import wait_until
from riot_bus.zenoh.session_config import access_control
from riot_bus.zenoh.sockets import hang_up, widen

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.zenoh.segments import Segment
    from riot_bus.zenoh.session_config import SessionConfig

__all__ = ["DirectLinks", "are_possible"]

_WITHIN_S = 10.0
_OWN = ("transport/auth", "access_control", "listen/endpoints", "connect/endpoints", "id")
_SELDOM = "#retry_period_init_ms=1000;retry_period_max_ms=3600000"  # nobody listens there any more once it is severed


class DirectLinks:
    """A link from each segment to each other, with the access control of a junction.

    It costs routers less than the way over a junction, so they take it. Access control is fixed when a router opens:
    when something else is to be cut, the links are severed for good, and the junction takes over.

    Args:
        names: Of the segments, in the order in which they will be opened.
        folder: Where the sockets will be; only this user may enter it.
        cut: Canonical key expressions that must not cross.
        services: Canonical key expressions of services that must not be seen or asked across.
    """

    def __init__(self, names: Sequence[str], folder: Path, *, cut: Sequence[str], services: Sequence[str]) -> None:
        self.severed = self._awaited = False
        self._cut = list(cut), list(services)
        self._names = list(names)
        self._paths = {name: folder / f"direct-{number}" for number, name in enumerate(names)}
        self._ids = {name: _new_id() for name in names}

    @property
    def ids(self) -> set[str]:
        """Ids of the segments that are linked; none when they are not any more."""
        return set() if self.severed else set(self._ids.values())

    def cuts(self, cut: Sequence[str], services: Sequence[str]) -> bool:
        """Return whether just this is cut."""
        return self._cut == (list(cut), list(services))

    def listen(self, name: str) -> list[str]:
        """Return where a segment has to listen for those that are opened later."""
        return [f"unixsock-stream/{self._paths[name]}"] if name != self._names[-1] else []

    def connect(self, name: str) -> list[str]:
        """Return what a segment has to connect to: those that are opened earlier."""
        return [f"unixsock-stream/{self._paths[other]}{_SELDOM}" for other in self._earlier(name)]

    def config(self, name: str) -> SessionConfig:
        """Return further configuration of a segment. Each end of a link guards what comes in."""
        others = [self._ids[other] for other in self._names if other != name]
        rules = access_control(self._cut[0], services=self._cut[1], peers=others) if others else {}
        return {"id": self._ids[name], **rules}

    def complete(self, segments: Sequence[Segment]) -> None:
        """Wait until all links are there, and let no other be made; if they are not there in time, have none.

        One that breaks must not come back: what it carries would overtake what goes over the junction meanwhile.
        """
        linked, self._awaited = _are_linked(segments), True
        self._unlink()
        if linked:
            widen({str(path) for path in self._paths.values()})
        else:
            self.sever(segments)

    def sever(self, segments: Sequence[Segment]) -> None:
        """Cut all links; return once the segments know; safe to call twice."""
        if self.severed:
            return
        # Zenoh 1.10.2 can panic when a link between routers closes while declarations are still under way on it, as
        # they are on one that is only just made.
        if not self._awaited:
            _are_linked(segments)
        for segment in segments:
            segment.flush(other.zid for other in segments if other is not segment)
        self.severed = True
        self._unlink()
        hang_up({str(path) for path in self._paths.values()})
        linked = set(self._ids.values())
        wait_until(lambda: not any(linked & segment.peers() for segment in segments), _WITHIN_S)

    def _unlink(self) -> None:
        for path in self._paths.values():
            path.unlink(missing_ok=True)

    def _earlier(self, name: str) -> list[str]:
        return self._names[: self._names.index(name)]


def are_possible(configs: Mapping[str, SessionConfig]) -> bool:
    """Return whether segments can be linked: nobody else decides who they are and whom they let in.

    Args:
        configs: By segment, Zenoh configuration that the user has given.
    """
    keys = {key for config in configs.values() for key in config}
    return not any(f"{key}/".startswith(f"{own}/") or own.startswith(f"{key}/") for key in keys for own in _OWN)


def _are_linked(segments: Sequence[Segment]) -> bool:
    """Return whether all segments are linked to one another, which is waited for."""
    ids = {segment.zid for segment in segments}
    return wait_until(lambda: all(ids <= segment.peers() | {segment.zid} for segment in segments), _WITHIN_S)


def _new_id() -> str:
    return f"{int.from_bytes(os.urandom(16)) | 1 << 124:x}"  # no leading zeros in Zenoh's ids
