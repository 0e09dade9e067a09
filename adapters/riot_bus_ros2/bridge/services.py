"""Services that cross a bridge."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.attachment import Attachment, build_attachment, renew_attachment
from riot_bus_ros2.keys import build_data_key
from riot_bus_ros2.rclpy_node.frames import BridgeFrame, BridgeFrameKind

if TYPE_CHECKING:
    from riot_bus.types.port import Closeable, PortQuery, SegmentAccess
    from riot_bus_ros2.bridge.node import NodeProcess
    from riot_bus_ros2.keys import DataKey

__all__ = ["OfferedService", "WantedService"]


class OfferedService:
    """Service whose server in the domain answers requests from the segment.

    Args:
        number: Number of the client in the domain.
        key: Key of the service.
        node: The node in the domain.
        port: The segment.
    """

    def __init__(self, number: int, key: DataKey, *, node: NodeProcess, port: SegmentAccess) -> None:
        self.number, self.key = number, key
        self.count = 0
        self._node, self._port = node, port
        self._inlet: Closeable | None = None
        self._open: dict[int, PortQuery] = {}
        self._lock = threading.Lock()

    def open(self) -> None:
        """Create a client in the domain."""
        self._node.tell(do="call", id=self.number, topic=self.key.topic, type=self.key.type_name)

    @property
    def works(self) -> bool:
        """Whether requests from the segment are answered."""
        return self._inlet is not None

    def update(self, *, ready: bool) -> None:
        """Accept requests as soon as the server would get them."""
        if ready and self._inlet is None:
            self._inlet = self._port.serve(build_data_key(self.key), self._ask)

    def take(self, frame: BridgeFrame) -> None:
        """Answer a request."""
        with self._lock:
            question = self._open.pop(frame.number, None)
        if question is None:
            return
        if frame.kind == BridgeFrameKind.RESPONSE:
            question.answer(frame.payload, _renewed(question.attachment))
        else:
            question.fail(frame.payload.decode(errors="replace"))

    def close(self) -> None:
        """Close the service; waiting clients are notified."""
        if self._inlet is not None:
            self._inlet.close()
        self._node.tell(do="drop", id=self.number)
        with self._lock:
            waiting, self._open = list(self._open.values()), {}
        for question in waiting:
            question.fail("the server is gone")

    def _ask(self, question: PortQuery) -> None:
        with self._lock:
            self.count += 1
            number = self.count
            self._open[number] = question
        self._node.send(BridgeFrameKind.REQUEST, self.number, number, question.payload)


class WantedService:
    """Service whose server on the segment answers requests from the domain.

    Args:
        number: Number of the server in the domain.
        key: Key of the service.
        node: The node in the domain.
        port: The segment.
    """

    def __init__(self, number: int, key: DataKey, *, node: NodeProcess, port: SegmentAccess) -> None:
        self.number, self.key = number, key
        self.gid = bytes(16)
        self.count = 0
        self._node, self._port = node, port
        self._asked: dict[int, Closeable | None] = {}
        self._lock = threading.Lock()

    def open(self) -> None:
        """Create a server in the domain."""
        self._node.tell(do="serve", id=self.number, topic=self.key.topic, type=self.key.type_name)

    def take(self, frame: BridgeFrame) -> None:
        """Send a request to the segment, or drop one that no client waits for any more."""
        if frame.kind == BridgeFrameKind.FAILURE:
            self._forget(frame.number)
            return
        self.count += 1
        attachment = build_attachment(Attachment(self.count, time.time_ns(), self.gid))
        with self._lock:
            self._asked[frame.number] = None
        asked = self._port.ask(build_data_key(self.key), frame.payload, attachment, partial(self._answer, frame.number))
        with self._lock:
            if frame.number in self._asked:  # else it is answered already
                self._asked[frame.number] = asked

    def close(self) -> None:
        """Close the service; pending requests remain unanswered."""
        self._node.tell(do="drop", id=self.number)
        for number in list(self._asked):
            self._forget(number)

    def _forget(self, number: int) -> None:
        with self._lock:
            asked = self._asked.pop(number, None)
        if asked is not None:
            asked.close()

    def _answer(self, number: int, payload: bytes | None) -> None:
        with self._lock:
            self._asked.pop(number, None)
        kind = BridgeFrameKind.FAILURE if payload is None else BridgeFrameKind.RESPONSE
        self._node.send(kind, self.number, number, payload or b"")


def _renewed(attachment: bytes | None) -> bytes | None:
    """Return a request's attachment for its response: with the current time, or unchanged if it is unreadable."""
    if attachment is None:
        return None
    try:
        return renew_attachment(attachment, source_time=time.time_ns())
    except PayloadError:
        return attachment
