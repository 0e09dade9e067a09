"""The junction: the router that joins all segments and keeps the intercepted keys apart."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from riot_bus.bus.config import WAIT_BEFORE_CLOSE_S, access_control, router_config
from riot_bus.bus.runtime import open_session, release, wait_until
from riot_bus.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import zenoh

    from riot_bus.bus.segments import Segment

__all__ = ["Junction"]

_PROBE_INTERVAL_S = 0.002
_FLUSH_S = 1.0


class Junction:
    """Joins segments; everything that is not cut flows through it natively and never enters Python.

    Access control cannot be changed in a running router, so another cut means another router with another id.

    Args:
        segments: At least two.
        inner: Where it listens by turns, for segments that it may not connect to.
        config: Further Zenoh configuration.
        wait_before_close_s: Longest wait of a BLOCK publication for a slow segment.
        timeout: Seconds within which links and routes must be up.
    """

    def __init__(
        self,
        segments: Sequence[Segment],
        *,
        inner: Sequence[str] = (),
        config: Mapping[str, Any] | None = None,
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
        timeout: float = 10.0,
    ) -> None:
        self.session: zenoh.Session | None = None
        self.zid = ""
        """Id of the present router, empty while the segments are apart."""
        self.ids: set[str] = set()
        """Ids of all routers that were in this place."""
        self._segments = tuple(segments)
        self._inner = itertools.cycle(inner)
        self._listens = any(not segment.open_to_all for segment in segments)
        self._config = dict(config or {})
        self._wait_before_close_s = wait_before_close_s
        self._timeout = timeout

    def open(self, cut: Sequence[str]) -> zenoh.Session:
        """Join the segments, or cut other keys if they are joined; return once links and routes are up.

        Args:
            cut: Canonical key expressions that must not cross.

        Raises:
            EnvironmentFaultError: The segments are not joined in time.
        """
        settings = router_config(
            connect=[segment.endpoints[0] for segment in self._segments if segment.open_to_all],
            listen=[next(self._inner)] if self._listens else [],
            wait_before_close_s=self._wait_before_close_s,
            extra={**self._config, **access_control(cut)},
        )
        # The former router stays until the new one works. If it left first, the new one would take its place in the
        # segments' tables, and they would not tell each other of subscriptions that exist already.
        former = self.session, self.zid
        if former[0] is not None:
            self._flush(former[1])  # what lanes have just undeclared
        self.session = open_session(settings, purpose="junction")
        self.zid = str(self.session.info.zid())
        self.ids.add(self.zid)
        if wait_until(self._linked, self._timeout) and self._routes():
            self._leave(*former)
            if former[0] is None or self._routes():
                return self.session
        self.close()
        self._leave(*former)
        names = ", ".join(each.name for each in self._segments)
        raise EnvironmentFaultError(
            f"the segments {names} were not joined in {self._timeout:g} s",
            where="junction",
            hint="is the machine overloaded? look at ZENOH_RUNTIME and at Zenoh's log (RUST_LOG=zenoh=debug)",
        )

    def close(self) -> None:
        """Separate the segments; return once all of them know; safe to call twice."""
        former, self.session = (self.session, self.zid), None
        self.zid = ""
        self._leave(*former)

    def _leave(self, session: zenoh.Session | None, zid: str) -> None:
        if session is not None:
            self._flush(zid)
            release(session)
            wait_until(lambda: all(zid not in segment.peers() for segment in self._segments), self._timeout)

    def _flush(self, zid: str) -> None:
        """Wait until the junction has taken in what segments told it.

        Zenoh 1.10.2 can panic when a link between routers closes while declarations are still under way on it.
        """
        for segment in self._segments:
            for _ in segment.session.get(f"@/{zid}/router", timeout=_FLUSH_S):
                pass

    def _linked(self) -> bool:
        return all(self.zid in segment.peers() for segment in self._segments)

    def _routes(self) -> bool:
        """Send probes between all segments until each has arrived: routes come about 100 ms after links."""
        import zenoh

        # A verbatim chunk (`@riot`) stays out of everybody's wildcards; the id keeps late probes of others out.
        key = {segment.name: f"@riot/{self.zid}/{number}" for number, segment in enumerate(self._segments)}
        channels = {
            segment.name: segment.session.declare_subscriber(
                key[segment.name], zenoh.handlers.RingChannel(1024), allowed_origin=zenoh.Locality.REMOTE
            )
            for segment in self._segments
        }
        missing = {(a.name, b.name) for a in self._segments for b in self._segments if a is not b}
        sessions = {segment.name: segment.session for segment in self._segments}

        def arrived() -> bool:
            for source, target in missing:
                sessions[source].put(key[target], source)
            for target, channel in channels.items():
                while (sample := channel.try_recv()) is not None:
                    missing.discard((sample.payload.to_string(), target))
            return not missing

        try:
            return wait_until(arrived, self._timeout, interval=_PROBE_INTERVAL_S)
        finally:
            release(*channels.values())
