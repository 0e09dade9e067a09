"""How components are connected: client or peer, shared memory, encrypted, with a password."""

from __future__ import annotations

from typing import Any

from riot_bus.zenoh.api import shm
from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.scenario import scenario

_STAMPING = "peers of one router talk directly, so nobody stamps; between segments, the segments' routers do"
_PEER = {"mode": "peer", "listen/endpoints": ["tcp/127.0.0.1:0"]}


@scenario(
    "peers",
    "Both ends are peers, whom a single router introduces to each other.",
    needs=("peer",),
    settings=_PEER,
    limits=dict.fromkeys(("native", "junction", "intercepted"), _STAMPING),
)
@scenario("tls", "Encrypted links.", needs=("tls",))
@scenario("mtls", "Encrypted links on which components show certificates as well.", needs=("mtls",))
@scenario("password", "Routers that ask for a user and a password.", needs=("password",))
class _PublishAndAsk(ScenarioEnd):
    """Messages of several sizes one way, and a query with its reply."""

    def left(self) -> Observation:
        publisher = self.publisher("x")
        self.meet()
        self.matched(publisher)
        for size in (0, 10, 1 << 20):
            publisher.put(b"x" * size, encoding="text/plain")
        self.finish("x")
        return self.ask("service", payload="question")

    def right(self) -> Observation:
        inbox = self.subscribe("*")
        self.answer("service", lambda query: query.reply(query.key_expr, "answer"))
        self.meet()
        return inbox.shown()


@scenario("peer_to_client", needs=("peer",))
class _PeerToClient(_PublishAndAsk):
    """A peer and a client, between whom the router carries everything."""

    def left(self) -> Observation:
        self.configure(mode="peer", listen__endpoints=["tcp/127.0.0.1:0"])
        return super().left()


@scenario("shared_memory", needs=("shm",))
class _SharedMemory(ScenarioEnd):
    """Payloads in shared memory."""

    def left(self) -> Observation:
        self.meet()
        provider = self.keep(shm.ShmProvider.default_backend(1 << 20))
        for size in (16, 1 << 16):
            buffer: Any = provider.alloc(size)
            buffer[:] = bytes(range(16)) * (size // 16)
            self.put("x", buffer)
        self.finish("x")

    def right(self) -> Observation:
        inbox = self.subscribe("x")
        self.meet()
        samples = inbox.until_end()
        seen = [[len(sample.payload.to_bytes()), sample.payload.as_shm() is not None] for sample in samples]
        return [seen, inbox.shown()]
