"""The connection of one process to the bus."""

from __future__ import annotations

from os import urandom
from struct import Struct
from time import monotonic, sleep, time_ns

import zenoh
from zenoh import handlers

from rover.inbox import Inbox
from rover.signals import ignore_stop, leave_on_stop
from rover.topics import key

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Self

    from rover.component import Component
    from rover.messages import Message

ATTACHMENT = Struct("<qqB16s")
GID_SIZE = 16
CHANNEL_SIZE = 8192
POLL = 0.005
OTHERS_START = 0.1
RESET = "rover/reset"

CONFIGURATION = """{
    mode: "client",
    connect: { endpoints: ["%s"], timeout_ms: 5000 },
    scouting: { multicast: { enabled: false }, gossip: { enabled: false } },
}"""


def attachment(sequence: int, source_time: int, gid: bytes) -> bytes:
    """Give what rmw_zenoh attaches to a message: sequence number, nanoseconds since the epoch, publisher."""
    return ATTACHMENT.pack(sequence, source_time, GID_SIZE, gid)


class Publisher:
    """Puts messages on one topic."""

    def __init__(self, session: zenoh.Session, topic: str) -> None:
        congestion = zenoh.CongestionControl.BLOCK
        self._publisher = session.declare_publisher(key(topic), congestion_control=congestion, express=True)
        self._gid = urandom(GID_SIZE)
        self._sequence = 0

    def put(self, message: Message) -> None:
        """Publish one message."""
        self._sequence += 1
        self._publisher.put(message.encode(), attachment=attachment(self._sequence, time_ns(), self._gid))

    def has_subscribers(self) -> bool:
        """Tell whether anyone listens."""
        # Typed as a bool, but it is an object, and true even if nobody listens.
        return bool(getattr(self._publisher.matching_status, "matching", True))


class Bus:
    """A client session with the topics of one component, whose messages a single loop in the main thread handles."""

    def __init__(self, endpoint: str) -> None:
        leave_on_stop()
        escaped = endpoint.replace("\\", "\\\\").replace('"', '\\"')
        try:
            self._session = zenoh.open(zenoh.Config.from_json5(CONFIGURATION % escaped))
        except zenoh.ZError as problem:
            raise SystemExit(f"cannot open a Zenoh session with a router at {endpoint!r}: {problem}") from None
        self._inbox = Inbox()
        self._publishers: dict[str, Publisher] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # An open session would keep the process alive after its main thread has died.
        ignore_stop()
        self._session.close()  # type: ignore[no-untyped-call]
        self._inbox.join()

    def join(self, component: Component) -> None:
        """Declare what a component hands out, then what it takes."""
        for topic in component.OUTPUTS:
            self._publishers[topic] = Publisher(self._session, topic)
        for topic in component.INPUTS:
            channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(CHANNEL_SIZE)
            self._inbox.add(topic, self._session.declare_subscriber(key(topic), channel))

    def publish(self, topic: str, message: Message) -> None:
        """Publish one message on a topic of a component that has joined."""
        self._publishers[topic].put(message)

    def wait_for_subscriber(self, topic: str, timeout: float) -> None:
        """Wait until somebody listens to a topic, or until `timeout` seconds have passed."""
        deadline = monotonic() + timeout
        publisher = self._publishers[topic]
        while not publisher.has_subscribers():
            if monotonic() >= deadline:
                return
            sleep(POLL)
        # The first one listens; what started together with it will in a moment.
        sleep(OTHERS_START)

    def join_resets(self) -> None:
        """Let `spin` end when everybody is to begin anew."""
        channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(CHANNEL_SIZE)
        self._inbox.add(RESET, self._session.declare_subscriber(RESET, channel))

    def spin(self, component: Component, until: float | None = None) -> None:
        """Let the component receive, until a time of the monotonic clock, or until it is to begin anew."""
        while (batch := self._inbox.next(until)) is not None:
            topic, samples = batch
            if topic == RESET:
                return
            for sample in samples:
                component.receive(topic, sample.payload.to_bytes())


def serve(kind: type[Component], endpoint: str) -> None:
    """Run a component that only reacts to messages."""
    with Bus(endpoint) as bus:
        component = kind(bus.publish)
        bus.join(component)
        bus.join_resets()
        while True:
            bus.spin(component)
            component = kind(bus.publish)
