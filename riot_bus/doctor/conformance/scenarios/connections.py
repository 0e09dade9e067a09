"""How components are connected: client or peer, shared memory, encrypted, with a password."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.samples import END, show_replies
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd


_STAMPING = "peers of one router talk directly, so nobody stamps; between segments, the segments' routers do"
_PEER = {"mode": "peer", "listen/endpoints": ["tcp/127.0.0.1:0"]}


def _publish_and_ask(end: ScenarioEnd) -> Observation:
    from riot_bus.zenoh import api as zenoh

    block = zenoh.CongestionControl.BLOCK
    publisher = end.session.declare_publisher(end.key("x"), congestion_control=block)
    end.meet()
    end.matched(publisher)
    for size in (0, 10, 1 << 20):
        publisher.put(b"x" * size, encoding="text/plain")
    publisher.put(END)
    seen = show_replies(end.session.get(end.key("service"), payload="question", timeout=5.0))
    end.together("done")
    return seen


def _receive_and_answer(end: ScenarioEnd) -> Observation:
    def answer(query: Any) -> None:
        with query:
            query.reply(query.key_expr, "answer")

    inbox = end.subscribe("*")
    queryable = end.session.declare_queryable(end.key("service"), answer)
    end.meet()
    seen = inbox.shown()
    end.together("done")
    return [seen, str(queryable.key_expr)]


@scenario(
    "peers", needs=("peer",), settings=_PEER, limits=dict.fromkeys(("native", "junction", "intercepted"), _STAMPING)
)
class _Peers:
    """Both ends are peers, whom a single router introduces to each other."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        return _publish_and_ask(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return _receive_and_answer(end)


@scenario("peer_to_client", needs=("peer",))
class _PeerToClient:
    """A peer and a client, between whom the router carries everything."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.configure(mode="peer", listen__endpoints=["tcp/127.0.0.1:0"])
        return _publish_and_ask(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return _receive_and_answer(end)


@scenario("shared_memory", needs=("shm",))
class _SharedMemory:
    """Payloads in shared memory."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh
        from riot_bus.zenoh.api import shm

        end.meet()
        provider = shm.ShmProvider.default_backend(1 << 20)
        for size in (16, 1 << 16):
            buffer: Any = provider.alloc(size)
            buffer[:] = bytes(range(16)) * (size // 16)
            end.session.put(end.key("x"), buffer, congestion_control=zenoh.CongestionControl.BLOCK)
        end.session.put(end.key("x"), END, congestion_control=zenoh.CongestionControl.BLOCK)
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("x")
        end.meet()
        samples = inbox.until_end()
        seen = [[len(sample.payload.to_bytes()), sample.payload.as_shm() is not None] for sample in samples]
        end.together("done")
        return [seen, inbox.shown()]


@scenario("tls", needs=("tls",))
class _Encrypted:
    """Encrypted links."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        return _publish_and_ask(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return _receive_and_answer(end)


@scenario("mtls", needs=("mtls",))
class _MutuallyEncrypted:
    """Encrypted links on which components show certificates as well."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        return _publish_and_ask(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return _receive_and_answer(end)


@scenario("password", needs=("password",))
class _Passwords:
    """Routers that ask for a user and a password."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        return _publish_and_ask(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return _receive_and_answer(end)
