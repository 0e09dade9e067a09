"""Topics and services that cross a bridge: each is a route between the node in the domain and the segment.

A route opens one side at once and joins the other only while something is there, so that publishers and servers see a
peer exactly when there is one at the other end:

    route            opened at once        joined                     while
    UpRoute          segment: publisher    domain: subscription       latched, or the segment subscribes
    DownRoute        domain: publisher     segment: subscription      the publisher matches (latched: exists)
    OfferedService   domain: client        segment: server            from when the domain's server is ready
    WantedService    domain: server        segment: a query           of each request, until its response
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_bridges.rclpy_node.frames import BridgeFrame, BridgeFrameKind
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.keys import build_data_key

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.types.port import Closeable
    from riot_bus_bridges.host.outer_port import OuterPort, Question
    from riot_bus_bridges.ros2.node import NodeProcess
    from riot_bus_bridges.ros2.plan import DomainGraph, DownPlan, UpPlan
    from riot_bus_ros2.keys import DataKey
    from riot_bus_ros2.tokens import EndpointKind


@dataclass(frozen=True, slots=True)
class RouteContext:
    """What the routes of a bridge share.

    Attributes:
        latched: Number of messages to keep for late joiners on the segment.
        changed: Called when subscribers on the segment appear or disappear.
        is_own: Returns whether an attachment belongs to a message from this bridge.
        refused: Called with the topic of a message that is too short to be valid.
    """

    node: NodeProcess
    port: OuterPort
    latched: int
    changed: Callable[[], None]
    is_own: Callable[[bytes | None], bool]
    refused: Callable[[str], None]


class BridgeRoute:
    """A topic or service that crosses the bridge.

    Attributes:
        token_kind: Kind of the token that announces the endpoints whose messages it carries to the segment.
    """

    way: ClassVar[str]
    token_kind: ClassVar[EndpointKind | None] = None

    def __init__(self, number: int, key: DataKey, plan: Any, context: RouteContext) -> None:
        self.number, self.key, self.plan = number, key, plan
        self.gid = bytes(16)
        self.count = 0
        self._context, self._node, self._port = context, context.node, context.port
        self._inlet: Closeable | None = None

    def open(self) -> None:
        """Create the endpoint in the domain that exists from the beginning, if any."""

    def update(self, graph: DomainGraph) -> None:
        """Join or leave the other side, as needed."""

    def carry(self, frame: BridgeFrame) -> None:
        """Carry a frame of the node to the segment."""

    def unsubscribe(self) -> None:
        """Take nothing more from the segment."""
        inlet, self._inlet = self._inlet, None
        if inlet is not None:
            inlet.close()

    def close(self) -> None:
        """End the route on both sides."""
        self.unsubscribe()
        self._node.tell(do="drop", id=self.number)

    def _order(self, do: str, **more: Any) -> None:
        self._node.tell(do=do, id=self.number, topic=self.key.topic, type=self.key.type_name, **more)


class UpRoute(BridgeRoute):
    """A topic from the domain to the segment."""

    way, token_kind = "to_segment", "MP"

    def __init__(self, number: int, key: DataKey, plan: UpPlan, context: RouteContext) -> None:
        super().__init__(number, key, plan, context)
        self._subscribed = self._closed = False
        self._outlet = self._port.publisher(
            build_data_key(key),
            reliable=plan.reliable,
            latched=context.latched if plan.latched else None,
            changed=context.changed,
        )

    def update(self, graph: DomainGraph) -> None:
        """Subscribe or unsubscribe in the domain."""
        wanted = self.plan.latched or self._outlet.matched()
        if wanted and not self._subscribed:
            self._order("subscribe", qos=self.plan.reader.numbers())
        elif self._subscribed and not wanted:
            self._node.tell(do="drop", id=self.number)
        self._subscribed = wanted

    def carry(self, frame: BridgeFrame) -> None:
        """Publish a message from the domain with its time of publication, or the current time if that is unknown."""
        attachment = build_attachment(Attachment(self.count + 1, frame.number or time.time_ns(), self.gid))
        try:
            self._outlet.put(frame.payload, attachment)
        except Exception:
            if not self._closed:
                raise
        else:
            self.count += 1

    def close(self) -> None:
        """End the route on both sides."""
        self._closed = True
        super().close()
        self._outlet.close()


class DownRoute(BridgeRoute):
    """A topic from the segment to the domain."""

    way = "to_domain"
    plan: DownPlan

    def open(self) -> None:
        """Create a publisher in the domain."""
        self._order("publish", qos=self.plan.writer.numbers())

    def update(self, graph: DomainGraph) -> None:
        """Subscribe or unsubscribe on the segment."""
        matched = graph.matched.get(self.number)  # None while there is no publisher yet
        wanted = matched is not None and (matched > 0 or self.plan.latched is not None)
        if not wanted:
            self.unsubscribe()
        elif self._inlet is None:
            self._inlet = self._port.subscribe(build_data_key(self.key), self._carry_message, latched=self.plan.latched)

    def _carry_message(self, payload: bytes, attachment: bytes | None) -> None:
        if self._context.is_own(attachment):
            return
        if len(payload) < 4:  # bytes of CDR's encapsulation
            self._context.refused(self.key.topic)
            return
        self.count += 1
        self._node.send(BridgeFrameKind.MESSAGE, self.number, 0, payload)


class OfferedService(BridgeRoute):
    """Service whose server in the domain answers requests from the segment."""

    way = "calls"

    def __init__(self, number: int, key: DataKey, plan: None, context: RouteContext) -> None:
        super().__init__(number, key, plan, context)
        self._open: dict[int, Question] = {}
        self._lock = threading.Lock()

    def open(self) -> None:
        """Create a client in the domain."""
        self._order("call")

    @property
    def works(self) -> bool:
        """Whether requests from the segment are answered."""
        return self._inlet is not None

    def update(self, graph: DomainGraph) -> None:
        """Accept requests as soon as the server would get them."""
        if self._inlet is None and self.number in graph.ready:
            self._inlet = self._port.serve(build_data_key(self.key), self._ask)

    def carry(self, frame: BridgeFrame) -> None:
        """Answer a request."""
        with self._lock:
            query = self._open.pop(frame.number, None)
        if query is None:
            return
        if frame.kind == BridgeFrameKind.RESPONSE:
            query.answer(frame.payload, _renewed(query.attachment))
        else:
            query.fail(frame.payload.decode(errors="replace"))

    def close(self) -> None:
        """End the route on both sides; waiting clients are notified."""
        super().close()
        with self._lock:
            unanswered, self._open = list(self._open.values()), {}
        for query in unanswered:
            query.fail("the server is gone")

    def _ask(self, query: Question) -> None:
        with self._lock:
            self.count += 1
            number = self.count
            self._open[number] = query
        self._node.send(BridgeFrameKind.REQUEST, self.number, number, query.payload)


class WantedService(BridgeRoute):
    """Service whose server on the segment answers requests from the domain."""

    way, token_kind = "calls", "SC"

    def __init__(self, number: int, key: DataKey, plan: None, context: RouteContext) -> None:
        super().__init__(number, key, plan, context)
        self._asked: dict[int, Closeable | None] = {}
        self._lock = threading.Lock()

    def open(self) -> None:
        """Create a server in the domain."""
        self._order("serve")

    def carry(self, frame: BridgeFrame) -> None:
        """Send a request to the segment, or drop one whose client does not wait for it any more."""
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
        """End the route on both sides; pending requests remain unanswered."""
        super().close()
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
        return build_attachment(parse_attachment(attachment)._replace(source_time=time.time_ns()))
    except PayloadError:
        return attachment
