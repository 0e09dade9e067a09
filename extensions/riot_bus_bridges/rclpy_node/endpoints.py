"""Publishers and subscriptions of serialized messages."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.serialization import deserialize_message, serialize_message

from .echoes import Echoes
from .frames import BridgeFrameKind
from .kinds import message_type, service_type
from .snapshot import profile_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rclpy.node import Node

    from .frames import Wire


_AT_ONCE, _BYTES_AT_ONCE = 64, 1 << 18  # messages of one subscription before others have their turn
_RELIABLE, _LATCHED = 1, 1


class Topics:
    """Makes publishers and subscriptions; those of one topic know each other."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._both: dict[tuple[str, str], _Both] = {}

    def publisher(self, topic: str, type_name: str, qos: Sequence[int]) -> Publisher:
        """Return a new publisher; raises what rclpy raises, or UnknownTypeError."""
        return Publisher(self._node, self._of(topic, type_name), topic, message_type(type_name), qos)

    def subscription(self, number: int, topic: str, type_name: str, qos: Sequence[int]) -> Subscription:
        """Return a new subscription; raises what rclpy raises, or UnknownTypeError."""
        return Subscription(self._node, self._of(topic, type_name), number, topic, message_type(type_name), qos)

    def _of(self, topic: str, type_name: str) -> _Both:
        return self._both.setdefault((topic, type_name), _Both())


class _Both:
    """State that the publisher and the subscription of a topic share."""

    def __init__(self) -> None:
        self.echoes = Echoes(1 << 12)  # a later echo counts as a message of others
        self.subscriptions: tuple[Sequence[int], ...] = ()
        self._lock = threading.Lock()

    def join(self, qos: Sequence[int]) -> None:
        """Add a subscription."""
        with self._lock:
            self.subscriptions = (*self.subscriptions, qos)
            self.echoes.most = max(self.echoes.most, 4 * qos[3])

    def leave(self, qos: Sequence[int]) -> None:
        """Remove a subscription."""
        with self._lock:
            found = list(self.subscriptions)
            found.remove(qos)
            self.subscriptions = tuple(found)


class Publisher:
    """A publisher; see `Topics`."""

    def __init__(self, node: Node, both: _Both, topic: str, kind: Any, qos: Sequence[int]) -> None:
        self.topic = topic
        self._node, self._both = node, both
        self._qos = qos
        self._publisher: Any = node.create_publisher(kind, topic, profile_of(qos))

    def publish(self, payload: bytes) -> None:
        """Publish a serialized message."""
        if self._both.subscriptions or self._qos[1] == _LATCHED:
            self._both.echoes.publish(payload, self._publisher.publish)
        else:
            self._publisher.publish(payload)

    def matched(self) -> int:
        """Return the number of other processes' subscriptions that match."""
        own = sum(_matches(self._qos, each) for each in self._both.subscriptions)
        return max(0, int(self._publisher.get_subscription_count()) - own)

    def settle(self, seconds: float) -> None:
        """Wait, for `seconds` at most, until reliable subscriptions have everything that was published."""
        self._publisher.wait_for_all_acked(Duration(nanoseconds=int(seconds * 1e9)))

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)


class Subscription:
    """A subscription; see `Topics`.

    Attributes:
        lost: Number of published messages that did not arrive, as far as it can be known: while there is one publisher
            and the middleware numbers its messages.
    """

    def __init__(self, node: Node, both: _Both, number: int, topic: str, kind: Any, qos: Sequence[int]) -> None:
        self.topic = topic
        self._node, self._both, self._number, self._kind, self._qos = node, both, number, kind, qos
        self.lost = 0
        self._publishers: tuple[str, ...] = ()
        self._last: int | None = None
        both.join(qos)
        try:
            self._subscription: Any = node.create_subscription(
                kind, topic, lambda message: None, profile_of(qos), raw=True
            )
        except BaseException:
            both.leave(qos)
            raise
        self.handle: Any = self._subscription.handle

    def forward(self, wire: Wire) -> bool:
        """Forward the messages from others; return whether there may be more."""
        take, kind, is_echo = self.handle.take_message, self._kind, self._both.echoes.is_echo
        found: list[tuple[int, bytes]] = []
        size = 0
        try:
            for _ in range(_AT_ONCE):
                taken = take(kind, True)  # noqa: FBT003 - rclpy takes no names here
                if taken is None:
                    return False
                payload, info = taken
                published = info["source_timestamp"]
                if not is_echo(payload, published):
                    self._count(info.get("publication_sequence_number"))
                    found.append((published, payload))
                    size += len(payload)
                    if size >= _BYTES_AT_ONCE:
                        break
        finally:
            if found:
                wire.send_messages(self._number, found)
        return True

    def set_publishers(self, publishers: Iterable[str]) -> None:
        """Record the gids of the publishers."""
        found = tuple(sorted(publishers))
        if found != self._publishers:
            self._publishers, self._last = found, None

    def _count(self, sequence: int | None) -> None:
        if sequence is None or len(self._publishers) != 1:
            return
        if self._last is not None and sequence > self._last:
            self.lost += sequence - self._last - 1
        self._last = sequence

    def close(self) -> None:
        """Destroy the subscription."""
        self._node.destroy_subscription(self._subscription)
        self._both.leave(self._qos)


def _matches(offered: Sequence[int], requested: Sequence[int]) -> bool:
    """Return whether DDS matches a subscription of ours with a publisher of ours."""
    return (offered[0] == _RELIABLE or requested[0] != _RELIABLE) and (
        offered[1] == _LATCHED or requested[1] != _LATCHED
    )


_MOST_OPEN = 1024  # a guess: unanswered requests would be kept for ever
_CALLS_AT_ONCE = 16  # then other services and topics get their turn; not measured


class Server:
    """Takes requests from the domain for a server on the segment."""

    def __init__(self, node: Node, number: int, topic: str, type_name: str) -> None:
        self.topic = topic
        self._node, self._number = node, number
        self._kind = service_type(type_name)
        self._service: Any = node.create_service(self._kind, topic, lambda request, response: response)
        self.handle: Any = self._service.handle
        self._open: dict[int, Any] = {}
        self._next = 0
        self._lock = threading.Lock()

    def forward(self, wire: Wire) -> bool:
        """Forward the requests that have arrived; return whether there may be more."""
        for _ in range(_CALLS_AT_ONCE):
            request, header = self.handle.service_take_request(self._kind.Request) or (None, None)
            if header is None:
                return False
            forgotten = None
            with self._lock:
                self._next += 1
                number = self._next
                self._open[number] = header
                if len(self._open) > _MOST_OPEN:
                    forgotten = next(iter(self._open))
                    del self._open[forgotten]
            if forgotten is not None:
                wire.send(BridgeFrameKind.FAILURE, self._number, forgotten, b"too many requests are open")
            wire.send(BridgeFrameKind.REQUEST, self._number, number, bytes(serialize_message(request)))
        return True

    def answer(self, number: int, payload: bytes | None) -> None:
        """Send a response to the client, or forget the request."""
        with self._lock:
            header = self._open.pop(number, None)
        if header is not None and payload is not None:
            self._service.send_response(deserialize_message(payload, self._kind.Response), header)

    def close(self) -> None:
        """Destroy the service."""
        self._node.destroy_service(self._service)


class DomainClient:
    """Calls a server in the domain for clients on the segment."""

    def __init__(self, node: Node, number: int, topic: str, type_name: str) -> None:
        self.topic = topic
        self._node, self._number = node, number
        self._kind = service_type(type_name)
        self._client: Any = node.create_client(self._kind, topic)
        self.handle: Any = self._client.handle
        self._open: dict[int, int] = {}
        self._lock = threading.Lock()

    def ready(self) -> bool:
        """Return whether the server would get a request."""
        return bool(self._client.service_is_ready())

    def ask(self, number: int, payload: bytes, wire: Wire) -> None:
        """Send a request; it fails if it is not of this type."""
        try:
            request = deserialize_message(payload, self._kind.Request)
            with self._lock:
                self._open[self.handle.send_request(request)] = number
                lost = self._open.pop(next(iter(self._open))) if len(self._open) > _MOST_OPEN else None
        except Exception as error:
            wire.send(BridgeFrameKind.FAILURE, self._number, number, str(error).encode(), patient=False)
            return
        if lost is not None:
            wire.send(BridgeFrameKind.FAILURE, self._number, lost, b"too many requests are open", patient=False)

    def forward(self, wire: Wire) -> bool:
        """Forward the responses that have arrived; return whether there may be more."""
        for _ in range(_CALLS_AT_ONCE):
            with self._lock:
                header, response = self.handle.take_response(self._kind.Response) or (None, None)
                if header is None:
                    return False
                number = self._open.pop(header.request_id.sequence_number, None)
            if number is not None:
                wire.send(BridgeFrameKind.RESPONSE, self._number, number, bytes(serialize_message(response)))
        return True

    def close(self) -> None:
        """Destroy the client."""
        self._node.destroy_client(self._client)
