"""Topics that cross a bridge."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from riot_bus_ros2.attachment import Attachment, build_attachment
from riot_bus_ros2.keys import build_data_key
from riot_bus_ros2.rclpy_node.frames import BridgeFrameKind

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.types.port import Closeable, SegmentAccess
    from riot_bus_ros2.bridge.node import NodeProcess
    from riot_bus_ros2.bridge.plan import Down, Up
    from riot_bus_ros2.keys import DataKey

__all__ = ["DownRoute", "UpRoute"]

_LEAST = 4  # bytes of CDR's encapsulation


class UpRoute:
    """A topic from the domain to the segment.

    A topic that is not latched is subscribed to only while it has a subscriber on the segment. So publishers see a
    subscription when there is one at the other end, and no message is carried without a receiver.

    Args:
        number: Number of the subscription.
        key: Key of the topic.
        plan: QoS and sides of the topic.
        node: The node in the domain.
        port: The segment.
        latched: Number of messages to keep for late joiners.
        changed: Called when subscribers on the segment appear or disappear.
    """

    def __init__(
        self,
        number: int,
        key: DataKey,
        plan: Up,
        *,
        node: NodeProcess,
        port: SegmentAccess,
        latched: int,
        changed: Callable[[], None],
    ) -> None:
        self.number, self.key, self.plan = number, key, plan
        self.gid = bytes(16)
        self.count = 0
        self._node = node
        self._subscribed = self._closed = False
        self._outlet = port.publisher(
            build_data_key(key), reliable=plan.reliable, latched=latched if plan.latched else None, changed=changed
        )

    def update(self) -> None:
        """Subscribe or unsubscribe, as needed."""
        wanted = self.plan.latched or self._outlet.matched()
        if wanted and not self._subscribed:
            topic, kind = self.key.topic, self.key.type_name
            self._node.tell(do="subscribe", id=self.number, topic=topic, type=kind, qos=self.plan.reader.numbers())
        elif self._subscribed and not wanted:
            self._node.tell(do="drop", id=self.number)
        self._subscribed = wanted

    def take(self, published: int, payload: bytes) -> None:
        """Publish a message from the domain.

        Args:
            published: Time of publication, nanoseconds since the Unix epoch; 0 if unknown.
            payload: Payload of the message.
        """
        attachment = build_attachment(Attachment(self.count + 1, published or time.time_ns(), self.gid))
        try:
            self._outlet.put(payload, attachment)
        except Exception:
            if not self._closed:
                raise
        else:
            self.count += 1

    def close(self) -> None:
        """End it."""
        self._closed = True
        self._node.tell(do="drop", id=self.number)
        self._outlet.close()


class DownRoute:
    """A topic from the segment to the domain.

    A topic that is not latched is subscribed to only while matching subscriptions exist in the domain.

    Args:
        number: Identifies the publisher.
        key: Topic.
        plan: QoS and sides of the topic.
        node: The node in the domain.
        port: The segment.
        is_own: Returns whether an attachment belongs to a message from this bridge.
        refused: Called with the topic of a message that is too short to be valid.
    """

    def __init__(
        self,
        number: int,
        key: DataKey,
        plan: Down,
        *,
        node: NodeProcess,
        port: SegmentAccess,
        is_own: Callable[[bytes | None], bool],
        refused: Callable[[str], None],
    ) -> None:
        self.number, self.key, self.plan = number, key, plan
        self.count = 0
        self._node, self._port, self._is_own, self._refused = node, port, is_own, refused
        self._inlet: Closeable | None = None

    def open(self) -> None:
        """Create a publisher in the domain."""
        self._node.tell(
            do="publish", id=self.number, topic=self.key.topic, type=self.key.type_name, qos=self.plan.writer.numbers()
        )

    def update(self, matched: int | None) -> None:
        """Subscribe or unsubscribe, as needed.

        Args:
            matched: Number of matching subscriptions; None while there is no publisher yet.
        """
        wanted = matched is not None and (matched > 0 or self.plan.latched is not None)
        if wanted and self._inlet is None:
            self._inlet = self._port.subscribe(build_data_key(self.key), self._take, latched=self.plan.latched)
        elif not wanted:
            self.mute()

    def mute(self) -> None:
        """Stop taking messages from the segment."""
        if self._inlet is not None:
            self._inlet.close()
            self._inlet = None

    def close(self) -> None:
        """End it."""
        self.mute()
        self._node.tell(do="drop", id=self.number)

    def _take(self, payload: bytes, attachment: bytes | None) -> None:
        if self._is_own(attachment):
            return
        if len(payload) < _LEAST:
            self._refused(self.key.topic)
            return
        self.count += 1
        self._node.send(BridgeFrameKind.MESSAGE, self.number, 0, payload)
