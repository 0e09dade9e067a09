"""A segment: one isolated router of the bus, to which components connect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.keyexpr_pins import begin_pinning, end_pinning
from riot_bus.zenoh.libraries import borrow, give_back
from riot_bus.zenoh.session import listening, open_session, release
from riot_bus.zenoh.session_config import WAIT_BEFORE_CLOSE_S, router_config

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from types import ModuleType

__all__ = ["EPHEMERAL", "Segment"]

EPHEMERAL = "tcp/127.0.0.1:0"
"""Listen on a free port of this machine; `Segment.endpoints` tells which."""

_FLUSH_S = 1.0
_RETRY = {"period_init_ms": 20, "period_max_ms": 20, "period_increase_factor": 1}


class Segment:
    """One isolated router; opened when it is made.

    Args:
        name: The segment's name.
        listen: Endpoints to listen on; none means a free port of this machine.
        connect: Routers and peers outside that it joins.
        doors: Where junctions may connect.
        inner: Where junctions will listen, if the segment lets nobody in without asking who it is.
        hidden: Further endpoints to listen on, for other segments.
        config: Further Zenoh configuration.
        wait_before_close_s: Longest wait of a BLOCK publication for a slow receiver.

    Raises:
        EnvironmentFaultError: An endpoint is in use.
    """

    def __init__(
        self,
        name: str,
        listen: Sequence[str] = (),
        *,
        connect: Sequence[str] = (),
        doors: Sequence[str] = (),
        inner: Sequence[str] = (),
        hidden: Sequence[str] = (),
        config: Mapping[str, Any] | None = None,
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
    ) -> None:
        self.name = name
        listen = listen or [EPHEMERAL]
        settings = router_config(
            listen=[*listen, *doors, *hidden],
            connect=[*connect, *inner],
            wait_before_close_s=wait_before_close_s,
            extra={**({"connect/retry": _RETRY} if inner else {}), **(config or {})},
        )
        self._library: ModuleType | None = borrow()
        try:
            self.session = open_session(settings, purpose=f"segment {name!r}", library=self._library)
        except BaseException:
            give_back(self._library)
            raise
        begin_pinning(self.session)
        self.zid = str(self.session.info.zid())
        found = [each for each in listening(self.session) if each not in {*doors, *hidden}]
        self.endpoints = tuple(found or listen)  # Zenoh does not show where it listens for ws
        """Where components can connect."""
        self.doors = tuple(doors)
        """Where junctions may connect; if there is none, the segment connects to the junction."""

    def peers(self) -> set[str]:
        """Return the ids of the sessions that are connected."""
        return {str(transport.zid) for transport in self.session.info.transports()}

    def flush(self, zids: Iterable[str]) -> None:
        """Wait until neighbours have taken in what this segment told them; not for long."""
        for zid in zids:
            for _ in self.session.get(f"@/{zid}/router", timeout=_FLUSH_S):
                pass

    def close(self) -> None:
        """Disconnect everybody; safe to call twice."""
        release(self.session)
        end_pinning(self.session)
        library, self._library = self._library, None
        if library is not None:
            give_back(library)


def is_open_to_all(listen: Sequence[str], config: Mapping[str, Any]) -> bool:
    """Return whether anybody on this machine may connect to a segment, the junction included.

    Args:
        listen: Endpoints that the segment listens on.
        config: Its Zenoh configuration.
    """
    plain = all(text.startswith("tcp/") for text in list(listen)[:1])
    return plain and not any(key.startswith(("transport/auth", "access_control")) for key in config)
