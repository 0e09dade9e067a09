"""Direct links between segments: until the cut keys change, other messages pass two routers instead of three."""

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

_WITHIN_S = 10.0  # as the default timeout of `Network`; then the junction takes over
_OWN = ("transport/auth", "access_control", "listen/endpoints", "connect/endpoints", "id")
_SELDOM = "#retry_period_init_ms=1000;retry_period_max_ms=3600000"  # the socket is closed for good once it is severed


class DirectLinks:
    """A link from each segment to each other, with the access control of a junction.

    Routers prefer it, since its cost is lower than that of the way over a junction. Access control is fixed when a
    router opens: when other keys are to be cut, the links are severed for good, and the junction takes over.

    Args:
        names: Names of the segments, in the order in which they will be opened.
        folder: Folder for the sockets; only this user may enter it.
        cut: Canonical key expressions of messages that must not cross.
        services: Canonical key expressions of services that must not be visible or called across.
    """

    def __init__(self, names: Sequence[str], folder: Path, *, cut: Sequence[str], services: Sequence[str]) -> None:
        self.severed = self._awaited = False
        self._cut = list(cut), list(services)
        self._names = list(names)
        self._paths = {name: folder / f"direct-{number}" for number, name in enumerate(names)}
        self._ids = {name: _new_id() for name in names}

    @property
    def ids(self) -> set[str]:
        """Ids of the linked segments; empty once the links are severed."""
        return set() if self.severed else set(self._ids.values())

    def cuts(self, cut: Sequence[str], services: Sequence[str]) -> bool:
        """Return whether exactly these keys and services are cut."""
        return self._cut == (list(cut), list(services))

    def listen(self, name: str) -> list[str]:
        """Return the endpoints on which a segment listens for segments that are opened later."""
        return [f"unixsock-stream/{self._paths[name]}"] if name != self._names[-1] else []

    def connect(self, name: str) -> list[str]:
        """Return the endpoints of segments opened earlier, to which a segment connects."""
        return [f"unixsock-stream/{self._paths[other]}{_SELDOM}" for other in self._earlier(name)]

    def config(self, name: str) -> SessionConfig:
        """Return further configuration of a segment; each end of a link filters incoming messages."""
        others = [self._ids[other] for other in self._names if other != name]
        rules = access_control(self._cut[0], services=self._cut[1], peers=others) if others else {}
        return {"id": self._ids[name], **rules}

    def complete(self, segments: Sequence[Segment]) -> None:
        """Wait until all links are up, and prevent further ones; if they are not up in time, sever them.

        A broken link must not come back: its messages would overtake those that went over the junction meanwhile.
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
        # Zenoh 1.10.2 can panic when a link between routers closes while declarations are in transit on it, as they are
        # on a new link.
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
    """Return whether segments can be linked: the user configures neither their ids, endpoints nor access control."""
    keys = {key for config in configs.values() for key in config}
    return not any(f"{key}/".startswith(f"{own}/") or own.startswith(f"{key}/") for key in keys for own in _OWN)


def _are_linked(segments: Sequence[Segment]) -> bool:
    """Wait until all segments are linked to one another; return whether they are."""
    ids = {segment.zid for segment in segments}
    return wait_until(lambda: all(ids <= segment.peers() | {segment.zid} for segment in segments), _WITHIN_S)


def _new_id() -> str:
    return f"{int.from_bytes(os.urandom(16)) | 1 << 124:x}"  # no leading zeros in Zenoh's ids
