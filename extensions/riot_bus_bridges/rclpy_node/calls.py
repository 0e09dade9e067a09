"""Servers and clients of services. rclpy has no serialized requests, so they are deserialized and serialized here."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from rclpy.serialization import deserialize_message, serialize_message

from .frames import BridgeFrameKind
from .kinds import service_type

if TYPE_CHECKING:
    from rclpy.node import Node

    from .frames import Wire

_MOST_OPEN = 1024  # a guess: unanswered requests would be kept for ever
_AT_ONCE = 16  # then other services and topics get their turn; not measured


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
        for _ in range(_AT_ONCE):
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
        for _ in range(_AT_ONCE):
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
