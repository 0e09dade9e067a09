"""A segment: one isolated router of the bus, to which components connect."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any

from riot_bus.zenoh.keyexpr_pins import begin_pinning, end_pinning
from riot_bus.zenoh.libraries import borrow, give_back
from riot_bus.zenoh.session import listening, open_session, release
from riot_bus.zenoh.session_config import WAIT_BEFORE_CLOSE_S, router_config

EPHEMERAL = "tcp/127.0.0.1:0"
"""Endpoint for a free port of this machine; the actual port is in `Segment.endpoints`."""

_RETRY = {"period_init_ms": 20, "period_max_ms": 20, "period_increase_factor": 1}  # of the same process: soon there


class Segment:
    """One isolated router, opened by the constructor.

    Args:
        listen: Endpoints to listen on; empty for a free port of this machine.
        connect: Endpoints of external routers and peers to connect to.
        doors: Endpoints to which junctions may connect.
        inner: Endpoints on which junctions will listen, if the segment restricts who may connect.
        hidden: Further endpoints to listen on, for other segments.
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
        """Endpoints to which components can connect."""
        self.doors = tuple(doors)
        """Endpoints to which junctions may connect; if empty, the segment connects to the junction."""

    def peers(self) -> set[str]:
        """Return the ids of the sessions that are connected."""
        return {str(transport.zid) for transport in self.session.info.transports()}

    def flush(self, zids: Iterable[str]) -> None:
        """Wait, for a limited time, until neighbours have processed the declarations of this segment."""
        for zid in zids:
            for _ in self.session.get(f"@/{zid}/router", timeout=1.0):  # one that hangs must not stop a change
                pass

    def close(self) -> None:
        """Disconnect all components; safe to call twice."""
        release(self.session)
        end_pinning(self.session)
        library, self._library = self._library, None
        if library is not None:
            give_back(library)


def is_open_to_all(listen: Sequence[str], config: Mapping[str, Any]) -> bool:
    """Return whether any process on this machine, including the junction, may connect to a segment."""
    plain = all(text.startswith("tcp/") for text in list(listen)[:1])
    return plain and not any(key.startswith(("transport/auth", "access_control")) for key in config)
