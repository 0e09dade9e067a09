"""Relays serialized messages between a ROS domain and the bridge, under the bridge's orders.

rclpy's executors examine every entity for each message. So the relay has its own wait set, used as in
`rclpy.wait_for_message`; it also allows a request to be answered after its callback has returned.
"""

from __future__ import annotations

import contextlib
import os
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from .calls import DomainClient, Server
from .frames import BridgeFrameKind
from .snapshot import GraphSnapshot
from .topics import Publisher, Subscription, Topics

if TYPE_CHECKING:
    from .frames import BridgeFrame, Wire

EndT = TypeVar("EndT")
FoundT = TypeVar("FoundT")

_WAIT_NS = 1_000_000_000  # orders and the end trigger the guard; only a missed trigger waits so long
_LINGER_S = 2.0  # longest delay of the last messages at the end
_LOOK_S, _LOOK_OFTEN_S = 0.1, 0.02  # so late new endpoints are told; `_SHARE` bounds what looks cost
_BUSY_S = 1.0  # a node makes its endpoints one after another: a change announces more
_SHARE = 20  # a twentieth of the time is spent on looking at the graph


class Relay:
    """The node; a bridge has one."""

    def __init__(self, wire: Wire, name: str) -> None:
        self._wire = wire
        self._context = Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(
            name,
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        )
        self._guard: Any = self._node.create_guard_condition(lambda: None)
        self._topics = Topics(self._node)
        self._publishers: dict[int, Publisher] = {}
        self._subscriptions: dict[int, Subscription] = {}
        self._servers: dict[int, Server] = {}
        self._clients: dict[int, DomainClient] = {}
        self._all: tuple[dict[int, Any], ...] = (self._publishers, self._subscriptions, self._servers, self._clients)
        self._writers: dict[str, list[str]] = {}
        self._gone: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._events: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._changed = threading.Event()
        self._stopping = threading.Event()
        self._draining = False

    def run(self) -> None:
        """Relay until the bridge hangs up."""
        rmw = rclpy.get_rmw_implementation_identifier()
        distribution = os.environ.get("ROS_DISTRO", "")
        self._wire.tell({"event": "ready", "rmw": rmw, "distribution": distribution})
        threads = [threading.Thread(target=each, daemon=True) for each in (self._obey, self._watch)]
        for thread in threads:
            thread.start()
        try:
            self._spin()
            if self._draining:
                self._drain()
        except OSError:
            pass  # the bridge is gone
        finally:
            self._stopping.set()
            self._changed.set()
            self._wire.flush(_LINGER_S)
            self._wire.hang_up()
            for thread in threads:
                thread.join()
            deadline = time.monotonic() + _LINGER_S
            for publisher in self._publishers.values():
                publisher.settle(max(0.0, deadline - time.monotonic()))
            self._node.destroy_node()
            rclpy.shutdown(context=self._context)

    # -- from the domain ----------------------------------------------------------------------------------------------

    def _spin(self) -> None:
        sizes, wait_set = (-1, -1, -1), None
        while not self._stopping.is_set():
            subscriptions = list(self._subscriptions.values())
            clients, servers = list(self._clients.values()), list(self._servers.values())
            now = (len(subscriptions), len(clients), len(servers))
            if now != sizes or wait_set is None:
                sizes = now
                wait_set = rclpy_implementation.WaitSet(now[0], 1, 0, now[1], now[2], 0, self._context.handle)
            wait_set.clear_entities()
            wait_set.add_guard_condition(self._guard.handle)
            for subscription in subscriptions:
                wait_set.add_subscription(subscription.handle)
            for client in clients:
                wait_set.add_client(client.handle)
            for server in servers:
                wait_set.add_service(server.handle)
            wait_set.wait(_WAIT_NS)
            self._forward(subscriptions, set(wait_set.get_ready_entities("subscription")))
            self._forward(clients, set(wait_set.get_ready_entities("client")))
            self._forward(servers, set(wait_set.get_ready_entities("service")))
            with contextlib.suppress(queue.Empty):
                while True:
                    self._gone.get_nowait()()

    def _forward(self, endpoints: list[Any], ready: set[int]) -> None:
        for each in endpoints:
            if each.handle.pointer in ready:
                try:
                    each.forward(self._wire)
                except OSError:
                    raise
                except Exception as error:
                    self._tell({"event": "problem", "topic": each.topic, "problem": str(error)})

    def _drain(self) -> None:
        """Forward what has arrived before the end."""
        deadline = time.monotonic() + _LINGER_S
        ends: list[Any] = [*self._subscriptions.values(), *self._clients.values(), *self._servers.values()]
        for each in ends:
            while each.forward(self._wire) and time.monotonic() < deadline:
                pass

    # -- from the bridge ----------------------------------------------------------------------------------------------

    def _obey(self) -> None:
        while not self._draining and (frame := self._wire.receive()) is not None:
            try:
                if frame.kind == BridgeFrameKind.DOCUMENT:
                    self._order(frame.document())
                else:
                    self._deliver(frame)
            except OSError:
                break
            except Exception as error:
                self._tell({"event": "problem", "topic": self._topic(frame), "problem": str(error)})
        self._stopping.set()
        self._changed.set()
        self._guard.trigger()

    def _deliver(self, frame: BridgeFrame) -> None:
        if frame.kind == BridgeFrameKind.MESSAGE:
            publisher = self._publishers.get(frame.endpoint)
            if publisher is not None:
                publisher.publish(frame.payload)
        elif frame.kind == BridgeFrameKind.REQUEST:
            client = self._clients.get(frame.endpoint)
            if client is None:
                self._wire.send(
                    BridgeFrameKind.FAILURE, frame.endpoint, frame.number, b"the server is gone", patient=False
                )
            else:
                client.ask(frame.number, frame.payload, self._wire)
        else:
            server = self._servers.get(frame.endpoint)
            if server is not None:
                server.answer(frame.number, frame.payload if frame.kind == BridgeFrameKind.RESPONSE else None)

    def _order(self, order: dict[str, Any]) -> None:
        if order["do"] == "end":
            self._draining = True
            return
        number = order["id"]
        if order["do"] == "drop":
            self._drop(number)
            return
        try:
            if order["do"] == "publish":
                self._publishers[number] = self._topics.publisher(order["topic"], order["type"], order["qos"])
            elif order["do"] == "subscribe":
                subscription = self._topics.subscription(number, order["topic"], order["type"], order["qos"])
                subscription.set_publishers(self._writers.get(subscription.topic, ()))
                self._subscriptions[number] = subscription
            elif order["do"] == "serve":
                self._servers[number] = Server(self._node, number, order["topic"], order["type"])
            else:
                self._clients[number] = DomainClient(self._node, number, order["topic"], order["type"])
        except Exception as error:
            self._tell({"event": "failed", "id": number, "topic": order["topic"], "problem": str(error)})
        self._changed.set()
        self._guard.trigger()

    def _drop(self, number: int) -> None:
        for endpoints in self._all:
            found = endpoints.pop(number, None)
            if found is not None:
                self._gone.put(found.close)  # closed by the thread that may be waiting for it
        self._guard.trigger()

    # -- the graph ----------------------------------------------------------------------------------------------------

    def _watch(self) -> None:
        graph, changed = GraphSnapshot(self._node), 0.0
        last: dict[str, Any] = {}
        told: dict[int, int] = {}
        while not self._stopping.is_set():
            self._changed.clear()
            began = time.monotonic()
            try:
                found = graph.look()
                matched = _each(self._publishers, lambda each: each.matched())
                found["matched"] = {str(number): count for number, count in matched}
                found["ready"] = [number for number, ready in _each(self._clients, lambda each: each.ready()) if ready]
                writers: dict[str, list[str]] = {}
                for _, topic, *_, gid in found["publishers"]:
                    writers.setdefault(topic, []).append(gid)
                self._writers = writers
                for subscription in self._subscriptions.copy().values():
                    subscription.set_publishers(writers.get(subscription.topic, ()))
                if found != last:
                    last, changed = found, began
                    self._wire.tell({"event": "graph", **found})
                for number, each in self._subscriptions.copy().items():
                    if each.lost != told.get(number, 0):
                        told[number] = each.lost
                        self._wire.tell({"event": "lost", "id": number, "topic": each.topic, "count": each.lost})
                with contextlib.suppress(queue.Empty):
                    while True:
                        self._wire.tell(self._events.get_nowait())
            except OSError:
                return
            except Exception as error:
                self._tell({"event": "problem", "topic": "the graph", "problem": str(error)})
            now = time.monotonic()
            pause = _LOOK_OFTEN_S if now - changed < _BUSY_S else _LOOK_S
            self._changed.wait(max(pause, _SHARE * (now - began)))

    def _tell(self, event: dict[str, Any]) -> None:
        """Let the watching thread send an event, since the threads that relay messages must not wait for each other."""
        self._events.put(event)

    def _topic(self, frame: BridgeFrame) -> str:
        found = (endpoints[frame.endpoint].topic for endpoints in self._all if frame.endpoint in endpoints)
        return str(next(found, "the bridge's orders"))


def _each(ends: dict[int, EndT], ask: Callable[[EndT], FoundT]) -> Iterator[tuple[int, FoundT]]:
    """Yield the number and the answer of each publisher or client that is not destroyed in the meantime."""
    for number, each in ends.copy().items():
        with contextlib.suppress(rclpy_implementation.InvalidHandle):
            yield number, ask(each)
