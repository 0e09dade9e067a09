"""The router that joins the segments, except for the keys that are cut; it is replaced when other keys are to be cut.

| state | event | what happens | next state |
|---|---|---|---|
| apart | `begin` | a router is opened, without waiting for its links | begun |
| apart | `open` | a router is opened; wait for links and routes | joined, or apart after the timeout |
| begun | `open` with the same keys | wait for links and routes | joined, or apart |
| begun, joined | `open` with other keys | another router is opened; the former leaves | joined, or apart |
| | | once the new one reaches all segments | |
| joined | `open` with the same keys | nothing | joined |
| any | `close` | the router leaves | apart |
"""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.junction_sockets import JunctionSockets
from riot_bus.zenoh.libraries import borrow, give_back, library_of
from riot_bus.zenoh.session import open_session, release, wait_until
from riot_bus.zenoh.session_config import ANSWER_S, OWN_CHUNK, WAIT_BEFORE_CLOSE_S, access_control, router_config

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    import zenoh

    from riot_bus.zenoh.direct_links import DirectLinks
    from riot_bus.zenoh.segments import Segment

_PROBE_INTERVAL_S = 0.002  # routes are ready after 100 ms: they are used 2 % later at most
_ROUTES_S = 1.0  # ten times what routes usually take, 100 ms; doubled with each try
_FORGET_S = 0.2  # twice the 100 ms after which Zenoh computes routes anew; doubled with each try
_PROBES = 4  # only some subscriptions may get through; with four, no key was dead after 900 changes under load
_WEIGHTS = "routing/router/linkstate/transport_weights"
_LEAST_WEIGHT = 100  # Zenoh's default, which direct links have: they have to stay cheaper
_MOST_WEIGHT = 65_000  # Zenoh's weights have 16 bits, 65,535 at most


class _Router(NamedTuple):
    """One of the routers that join the segments in turn."""

    session: zenoh.Session | None = None
    zid: str = ""
    sockets: JunctionSockets | None = None


_APART = _Router()


class Junction:
    """Joins segments; messages that are not cut pass through it natively and never enter Python.

    While there are direct links between the segments, they pass through those instead.

    Access control cannot be changed in a running router, so a change of the cut keys needs a new router with a new id.

    Args:
        segments: The segments, at least two.
        direct: Direct links, which are severed when other keys are to be cut than they cut.
        inner: Endpoints to listen on in turn, for segments without doors; as many as others have doors, at least two.
        wait_before_close_s: Longest wait of a BLOCK publication for a slow segment.
        timeout: Seconds within which links and routes must be up.
    """

    def __init__(
        self,
        segments: Sequence[Segment],
        *,
        direct: DirectLinks | None = None,
        inner: Sequence[str] = (),
        config: Mapping[str, Any] | None = None,
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
        timeout: float = 10.0,
    ) -> None:
        self.ids: set[str] = set()
        """Ids of all routers used so far."""
        self._segments = tuple(segments)
        self._direct = direct
        self._probes = _probes(segments)
        self._sockets = itertools.cycle(_sockets(segments, inner))
        self._router = _APART
        self._left = -math.inf
        self._weight = _LEAST_WEIGHT
        self._begun: tuple[list[str], list[str]] | None = None
        self._joined: tuple[list[str], list[str]] | None = None
        self._config = dict(config or {})
        self._wait_before_close_s = wait_before_close_s
        self._library: ModuleType | None = borrow()
        self._timeout = timeout

    @property
    def session(self) -> zenoh.Session | None:
        """Session of the current router; None while the segments are apart."""
        return self._router.session

    @property
    def zid(self) -> str:
        """Id of the current router; empty while the segments are apart."""
        return self._router.zid

    def begin(self, cut: Sequence[str] = (), services: Sequence[str] = ()) -> None:
        """Begin to join the segments for the first time; `open` has to follow and waits until they are joined."""
        self._begin(cut, services)
        self._begun = list(cut), list(services)

    def open(self, cut: Sequence[str], services: Sequence[str] = ()) -> zenoh.Session:
        """Join the segments, or cut other keys if they are joined and cut others; return once links and routes are up.

        Raises:
            EnvironmentFaultError: The segments are not joined in time.
        """
        wanted = list(cut), list(services)
        if self.session is not None and self._joined == wanted:
            return self.session
        self._joined = None
        # The former router stays until the new one works. If it left first, the new one would take its place in the
        # segments' tables, and they would not tell each other of subscriptions that exist already.
        begun = self.session if self._begun == wanted else None
        self._begun = None
        former = self._router if begun is None else _APART
        patience = 1
        deadline = time.monotonic() + self._timeout
        while time.monotonic() < deadline:
            self.settle(patience)
            if former.session is not None:
                self._flush(former.zid)  # what forwarders have just undeclared
            session, begun = begun or self._begin(cut, services, former.sockets), None
            linked = wait_until(self._linked, deadline - time.monotonic())
            if self._router.sockets is not None:
                self._router.sockets.widen()
            if linked and self._routes({"": session}, patience * _ROUTES_S):
                self._leave(former)
                former = _APART
                if self._direct is not None and not self._direct.cuts(cut, services):
                    self._sever(self._direct)
                if self._routes({each.name: each.session for each in self._segments}, patience * _ROUTES_S):
                    self._joined = wanted
                    return session
            self._leave(self._router)
            self._router = former
            patience *= 2
        self.close()
        names = ", ".join(each.name for each in self._segments)
        raise EnvironmentFaultError(
            f"the segments {names} were not joined in {self._timeout:g} s",
            where="junction",
            hint="is the machine overloaded? look at ZENOH_RUNTIME and at Zenoh's log (RUST_LOG=zenoh=debug)",
        )

    def settle(self, patience: int = 1) -> None:
        """Wait, if necessary, until segments have recomputed their routes without the last router that left.

        They do so 100 ms later. Until then, zenoh 1.10.2 mistakes another router for the one that has left, and does
        not send it the subscriptions of components. The end of this is not observable, so probes check whether the wait
        was long enough; the former router still works meanwhile.
        """
        time.sleep(max(0.0, self._left + patience * _FORGET_S - time.monotonic()))

    def _begin(
        self, cut: Sequence[str], services: Sequence[str], taken: JunctionSockets | None = None
    ) -> zenoh.Session:
        sockets = next(each for each in self._sockets if each is not taken)
        rules = access_control(cut, services=services, tokens=self._tokens(cut))
        settings = router_config(
            connect=sockets.connect,
            listen=sockets.listen,
            wait_before_close_s=self._wait_before_close_s,
            extra={**self._config, **rules, _WEIGHTS: self._weights()},
        )
        session = open_session(settings, purpose="junction", library=self._library)
        self._router = _Router(session, str(session.info.zid()), sockets)
        self.ids.add(self.zid)
        return session

    def _weights(self) -> list[dict[str, Any]]:
        """Return the costs of the next router's links: higher than the current ones, so that it is not used yet.

        Between two ways of the same cost, each router chooses one as soon as it knows both. Until all have chosen the
        same one, messages arrive twice or overtake each other.
        """
        self._weight = self._weight % _MOST_WEIGHT + 1
        return [{"dst_zid": segment.zid, "weight": self._weight} for segment in self._segments]

    def close(self) -> None:
        """Separate the segments; return once all of them know; safe to call twice."""
        former, self._router, self._joined = self._router, _APART, None
        if self._direct is not None:
            self._sever(self._direct)
        try:
            self._leave(former)
        finally:
            library, self._library = self._library, None
            if library is not None:
                give_back(library)

    def _tokens(self, cut: Sequence[str]) -> list[str]:
        """Return key expressions of the tokens of advanced publishers that must not cross.

        If a token of a key has crossed already, tokens of that key continue to cross: otherwise its withdrawal would
        not be noticed, and it would stay for ever. The tokens of our own stand-ins never cross.
        """
        refused = []
        for expression in cut:
            text = f"{expression}/@adv/pub/"
            seen: Counter[str] = Counter()
            for segment in self._segments if self.session is not None else ():
                replies = segment.session.liveliness().get(f"{text}**", timeout=ANSWER_S)
                seen.update({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})
            crossed = any(number > 1 for number in seen.values())
            refused += [f"{text}{segment.zid}/**" for segment in self._segments] if crossed else [f"{text}**"]
        return refused

    def _leave(self, router: _Router) -> None:
        session, zid, sockets = router
        if session is None or sockets is None:
            return

        def parted() -> bool:
            return not session.info.transports() and all(zid not in each.peers() for each in self._segments)

        # Zenoh 1.10.2 can panic in a router that closes a link between routers which the other end closes, too.
        with ExitStack() as stack:
            stack.callback(sockets.reopen)
            stack.callback(release, session)
            self._flush(zid)
            sockets.end()
            wait_until(parted, self._timeout)
        self._left = time.monotonic()

    def _sever(self, direct: DirectLinks) -> None:
        if not direct.severed:
            direct.sever(self._segments)
            self._left = time.monotonic()

    def _flush(self, zid: str) -> None:
        """Wait until the junction has processed the declarations of the segments.

        Zenoh 1.10.2 can panic when a link between routers closes while declarations are in transit on it.
        """
        for segment in self._segments:
            segment.flush([zid])

    def _linked(self) -> bool:
        return all(self.zid in segment.peers() for segment in self._segments)

    def _routes(self, sources: Mapping[str, zenoh.Session], timeout: float) -> bool:
        """Send probes to all segments until each has arrived; routes are ready about 100 ms after links.

        They go to subscriptions that are as old as the segments: only these show that the junction knows the existing
        subscriptions of components.
        """
        missing = {(name, probe) for name in sources for probe in self._probes if probe.segment != name}
        text = self.zid.encode()

        def arrived() -> bool:
            for name, probe in missing:
                sources[name].put(probe.key, text + b" " + name.encode())
            for probe in {probe for _, probe in missing}:
                while (sample := probe.channel.try_recv()) is not None:
                    zid, _, name = sample.payload.to_bytes().partition(b" ")
                    if zid == text:
                        missing.discard((name.decode(), probe))
            return not missing

        return wait_until(arrived, timeout, interval=_PROBE_INTERVAL_S)


class _Probe(NamedTuple):
    """One of a segment's own subscriptions, for the junction to reach."""

    segment: str
    key: str
    subscriber: Any

    @property
    def channel(self) -> Any:
        return self.subscriber.handler


def _sockets(segments: Sequence[Segment], inner: Sequence[str]) -> list[JunctionSockets]:
    """Return the sockets over which junctions and segments connect, to be used in turn."""
    doors = list(zip(*(segment.doors for segment in segments if segment.doors), strict=True))
    listens = any(not segment.doors for segment in segments)
    count = len(doors) or len(inner)
    return [JunctionSockets(doors[k] if doors else (), [inner[k]] if listens else []) for k in range(count)]


def _probes(segments: Sequence[Segment]) -> list[_Probe]:
    """Return several probes for each segment, since only some of its subscriptions may get through."""
    result = []
    for segment in segments:
        zenoh = library_of(segment.session)
        for number in range(_PROBES):
            # Wildcards never match a verbatim chunk (`@riot`); the id excludes probes of other routers.
            key = f"{OWN_CHUNK}/{segment.zid}/{number}"
            channel: Any = zenoh.handlers.RingChannel(1024)
            declare = segment.session.declare_subscriber
            subscriber = declare(key, channel, allowed_origin=zenoh.Locality.REMOTE)
            result.append(_Probe(segment.name, key, subscriber))
    return result
