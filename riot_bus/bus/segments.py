"""A segment: one isolated router of the bus, to which components connect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.bus.config import WAIT_BEFORE_CLOSE_S, router_config
from riot_bus.bus.runtime import listening, open_session, release

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["EPHEMERAL", "Segment"]

EPHEMERAL = "tcp/127.0.0.1:0"
"""Listen on a free port of this machine; `Segment.endpoints` tells which."""


class Segment:
    """One isolated router; opened when it is made.

    Args:
        name: The segment's name.
        listen: Endpoints to listen on; none means a free port of this machine.
        inner: Further endpoint, for the junction alone.
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
        inner: str | None = None,
        config: Mapping[str, Any] | None = None,
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
    ) -> None:
        self.name = name
        self.inner = inner
        endpoints = [*(listen or [EPHEMERAL]), *([inner] if inner else [])]
        settings = router_config(listen=endpoints, wait_before_close_s=wait_before_close_s, extra=config)
        self.session = open_session(settings, purpose=f"segment {name!r}")
        self.zid = str(self.session.info.zid())
        self.endpoints = tuple(each for each in listening(self.session) if each != inner)
        """Where components can connect."""

    def peers(self) -> set[str]:
        """Return the ids of the sessions that are connected."""
        return {str(transport.zid) for transport in self.session.info.transports()}

    def close(self) -> None:
        """Disconnect everybody; safe to call twice."""
        release(self.session)
