"""A bridge between a ROS domain and a segment."""

from __future__ import annotations

import itertools
import logging
import secrets
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from riot_bus.types.capabilities import MOST_TOKENS
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.text_table import table_lines
from riot_bus_bridges.bridging import Bridge
from riot_bus_bridges.rclpy_node.frames import NODE_PREFIX, BridgeFrame, BridgeFrameKind
from riot_bus_bridges.ros2.announcer import Announcer, OtherBridge
from riot_bus_bridges.ros2.node import START_S, NodeProcess
from riot_bus_bridges.ros2.options import Names
from riot_bus_bridges.ros2.plan import BridgePlan, DomainGraph, plan_of
from riot_bus_bridges.ros2.routes import BridgeRoute, DownRoute, OfferedService, RouteContext, UpRoute, WantedService
from riot_bus_ros2.tokens import NodeEndpoint, parse_token

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from contextlib import ExitStack

    from riot_bus_bridges.host.outer_port import OuterPort
    from riot_bus_bridges.ros2.options import Ros2BridgeOptions
    from riot_bus_bridges.ros2.plan import DomainAnnouncement
    from riot_bus_ros2.keys import DataKey

_LOG = logging.getLogger(__name__)
_TOKENS = "@riot/bridge/ros2"
_LOOK_S = 0.5  # changes wake the thread at once; waits such as `_LINGER_S` end up to this late
_LINGER_S = 2.0  # longest delay of the last messages of a publisher that has gone
_RESTART_S = 10.0
"""Time for which a route stays whose last endpoint has gone: a node that is started again is back in 1 to 5 s, and Fast
DDS may never tell a participant that it just meets of a reader that goes at that moment (1 of 60 starts, without any
bridge); a reliable publisher then waits for that reader."""
_MOST_ROUTES = 4096  # a guess: peers may announce any number, and each is an endpoint on both sides
_ROUTES: tuple[type[BridgeRoute], ...] = (UpRoute, DownRoute, OfferedService, WantedService)


class Ros2Bridge(Bridge):
    """Bridges a ROS domain and a segment while it is open; raises ConfigError if an option is not usable."""

    def __init__(
        self, port: OuterPort, options: Ros2BridgeOptions, *, warn: Callable[[str], None] = _LOG.warning
    ) -> None:
        super().__init__(warn=warn)
        options.check()
        self._port, self._options = port, options
        self._names = Names(options)
        self.name = f"{NODE_PREFIX}{time.time_ns():016x}{secrets.token_hex(4)}"  # an older bridge has a smaller name
        self._node = NodeProcess(self.name, options, self._receive)
        self._announcer = Announcer(port, options.zenoh_domain)
        self._node_says: dict[str, Any] = {}
        self._graph: DomainGraph | None = None
        self._segment: dict[str, NodeEndpoint] = {}
        self._bridges: dict[str, OtherBridge] = {}
        self._context = RouteContext(
            self._node, port, options.latched, changed=self._wake, is_own=self._is_own, refused=self._refuse
        )
        self._routes: dict[type[BridgeRoute], dict[DataKey, Any]] = {kind: {} for kind in _ROUTES}
        self._by_number: dict[int, BridgeRoute] = {}
        self._numbers = itertools.count(1)
        self._absent: dict[int, float] = {}
        self._began = 0.0
        self._gids: frozenset[bytes] = frozenset()
        self._carried: dict[str, Counter[str]] = {"to_segment": Counter(), "to_domain": Counter(), "calls": Counter()}
        self._lost: dict[int, tuple[str, int]] = {}
        self._refused: Counter[str] = Counter()
        self._changed = threading.Condition()
        self._dirty = False
        self._settled = threading.Event()
        self._thread = threading.Thread(target=self._run, name="riot-bridge", daemon=True)

    def open(self, stack: ExitStack) -> None:
        """Start the node, and wait until what it sees of its domain is bridged."""
        stack.callback(self._node.close)
        options = self._options
        for watched, report in (
            (f"@ros2_lv/{options.zenoh_domain}/**", self._see_token),
            (f"{_TOKENS}/{options.zenoh_domain}/*/*/*", self._see_bridge),
        ):
            stack.callback(self._port.watch(watched, report).close)
        # Before the node starts, which takes time: bridges with a later name must see this token in time.
        mine = OtherBridge(options.domain, self._port.zid, self.name)
        stack.callback(self._port.announce(f"{_TOKENS}/{options.zenoh_domain}/{mine.token()}").close)
        self._node_says = self._node.start()
        stack.callback(self._close_routes)
        stack.callback(self._announcer.close)
        self._began = time.monotonic()
        self._thread.start()
        stack.callback(self._finish)
        stack.callback(self._join)
        self._await_first_look()

    def _await_first_look(self) -> None:
        deadline = time.monotonic() + START_S
        while not self._settled.wait(_LOOK_S) and not self.ended.is_set():
            if time.monotonic() > deadline:
                raise EnvironmentFaultError("the node does not see its ROS domain", where="bridge")
        if self.failure is not None:
            raise self.failure

    def status(self) -> dict[str, Any]:
        """Return the state of the bridge as JSON values."""
        carried = {way: counts.copy() for way, counts in self._carried.items()}
        for route in self._all_routes():
            carried[route.way][route.key.topic] += route.count
        topics = {
            topic: {way: carried[way][topic] for way in ("to_segment", "to_domain")}
            for topic in sorted({*carried["to_segment"], *carried["to_domain"]})
        }
        return {
            "domain": self._options.domain,
            "zenoh_domain": self._options.zenoh_domain,
            "endpoint": self._port.endpoint,
            "node": self.name,
            "rmw": self._node_says.get("rmw", ""),
            "topics": topics,
            "services": dict(sorted(carried["calls"].items())),
            "lost": dict(sorted(self._losses().items())),
            "refused": dict(sorted(self._refused.copy().items())),
            "problems": list(self.problems),
        }

    def ready(self) -> str:
        """Return a line that says what is bridged."""
        options, rmw = self._options, self._node_says.get("rmw", "")
        return f"ready: ROS domain {options.domain} ({rmw}) and {self._port.endpoint}, there {options.zenoh_domain}/..."

    def summary(self) -> Sequence[str]:
        """Return lines that say what crossed."""
        return summary_lines(self.status())

    def _receive(self, frame: BridgeFrame | None) -> None:
        """Carry what the node sends."""
        if frame is None:
            if not self.ended.is_set():
                self._fail("the ROS node of the bridge has ended", "what ROS says about it stands above")
        elif frame.kind == BridgeFrameKind.DOCUMENT:
            self._on_event(frame.document())
        else:
            route = self._by_number.get(frame.endpoint)
            try:
                if route is not None:
                    route.carry(frame)
            except Exception as error:
                self._problem(route.key.topic if route else "", str(error))

    def _on_event(self, event: dict[str, Any]) -> None:
        if event["event"] == "graph":
            self._graph = DomainGraph.of(event)
            self._wake()
        elif event["event"] == "lost":
            self._lost[event["id"]] = (event["topic"], event["count"])
            self._problem(event["topic"], "messages come faster than they can be carried; see --depth and --topics")
        else:  # the node could not carry out an order, or lost a message; reported once
            self._problem(event["topic"], event["problem"])

    def _see_token(self, token: str, present: bool) -> None:  # noqa: FBT001 - called back
        found = parse_token(token)
        if isinstance(found, NodeEndpoint) and found.node.zid != self._port.zid:
            with self._changed:
                room = not present or token in self._segment or len(self._segment) < MOST_TOKENS
                if not present:
                    self._segment.pop(token, None)
                elif room:
                    self._segment[token] = found
            if not room:
                self._problem(found.topic, f"more than {MOST_TOKENS} announced endpoints are not bridged")
            self._wake()

    def _see_bridge(self, token: str, present: bool) -> None:  # noqa: FBT001 - called back
        found = OtherBridge.parse(token)
        if found is None or found.name == self.name:
            return
        with self._changed:
            if not present:
                self._bridges.pop(token, None)
            elif len(self._bridges) < 1000:  # tokens can be forged
                self._bridges[token] = found
        self._wake()

    def _wake(self) -> None:
        with self._changed:
            self._dirty = True
            self._changed.notify()

    def _run(self) -> None:
        while not self.ended.is_set():
            with self._changed:
                self._changed.wait_for(lambda: self._dirty or self.ended.is_set(), _LOOK_S)
                self._dirty = False
                graph, segment, bridges = self._graph, list(self._segment.values()), list(self._bridges.values())
            if graph is None:
                continue
            try:
                self._fail_if_joined(graph, bridges)
                if self.ended.is_set() or self._may_meet_older(graph, bridges):
                    continue
                zids = {each.zid for each in bridges}
                self._reconcile(plan_of(graph, segment, self._names, self._options, bridges=zids), graph)
            except Exception as error:
                _LOG.exception("bridge")
                self._fail(f"the bridge has failed: {error}", None)
            self._settled.set()

    def _fail_if_joined(self, graph: DomainGraph, bridges: Sequence[OtherBridge]) -> None:
        """Fail if an older bridge joins the same domain and segment: messages would circulate between the two."""
        here = {name.rpartition("/")[2] for name in graph.bridges}
        older = sorted(each.name for each in bridges if each.name in here and each.name < self.name)
        if older:
            domain = self._options.domain
            text = f"another bridge ({older[0]}) relays ROS domain {domain} to this network already"
            self._fail(text, "give this one another --domain, or end the other")

    def _may_meet_older(self, graph: DomainGraph, bridges: Sequence[OtherBridge]) -> bool:
        """Return whether an older bridge may be in the same domain, where discovery takes time.

        The number of a domain proves nothing: separate domains of other hosts may have the same number.
        """
        if self._settled.is_set() or time.monotonic() - self._began > 5.0:
            return False
        here = {name.rpartition("/")[2] for name in graph.bridges}
        return any(
            each.domain == self._options.domain and each.name < self.name and each.name not in here for each in bridges
        )

    def _reconcile(self, plan: BridgePlan, graph: DomainGraph) -> None:
        planned: Sequence[Mapping[DataKey, Any]] = (
            plan.ups,
            plan.downs,
            dict.fromkeys(plan.offered),
            dict.fromkeys(plan.wanted),
        )
        for kind, plans in zip(_ROUTES, planned, strict=True):
            self._drop(kind, [route for route in self._routes[kind].values() if not self._stays(route, plans)])
        new: list[BridgeRoute] = []
        for kind, plans in zip(_ROUTES, planned, strict=True):
            for key in self._new(plans, self._routes[kind]):
                route = self._routes[kind][key] = kind(next(self._numbers), key, plans[key], self._context)
                new.append(route)
        self._by_number = {route.number: route for route in self._all_routes()}
        for route in new:  # now that the receivers of their messages are known
            route.open()
        for service in self._routes[OfferedService].values():
            service.update(graph)
        self._announcer.update(plan.announcements, may_show=self._keeps_promise)
        gids = self._announcer.gids
        self._gids = frozenset(gids.values())
        for route in self._all_routes():
            if route.token_kind is not None:
                route.gid = gids.get((route.token_kind, route.key), route.gid)
            route.update(graph)
        for topic in plan.foreign:
            self._problem(topic, "domain and segment have different types for it, or different versions of its type")

    def _new(self, wanted: Mapping[DataKey, Any], routes: Mapping[DataKey, BridgeRoute]) -> list[DataKey]:
        found = sorted((key for key in wanted if key not in routes), key=lambda key: key.topic)
        room = max(0, _MOST_ROUTES - len(routes))
        if len(found) > room:
            self._problem(found[room].topic, f"more than {_MOST_ROUTES} are not bridged")
        return found[:room]

    def _stays(self, route: BridgeRoute, plans: Mapping[DataKey, Any]) -> bool:
        """Return whether a route stays as it is; topics linger when their publishers or endpoints have just gone."""
        if not isinstance(route, UpRoute | DownRoute):
            return route.key in plans
        plan = plans.get(route.key)
        if plan is not None:
            same: bool = plan.means(route.plan)
            sourced = route.plan.sourced
            if same:
                route.plan = plan
            if same or plan.sourced or not sourced:
                self._absent.pop(route.number, None)
                return same
        since = self._absent.setdefault(route.number, time.monotonic())
        if time.monotonic() - since < (_RESTART_S if plan is None else _LINGER_S):
            return True
        del self._absent[route.number]
        return False

    def _drop(self, kind: type[BridgeRoute], routes: Sequence[BridgeRoute]) -> None:
        for route in routes:
            del self._routes[kind][route.key]
            route.close()
            self._carried[route.way][route.key.topic] += route.count

    def _keeps_promise(self, announcement: DomainAnnouncement) -> bool:
        """Return whether something may be announced: servers only once they answer."""
        if announcement.kind != "SS" or announcement.key is None:
            return True
        service = self._routes[OfferedService].get(announcement.key)
        return service is not None and service.works

    def _is_own(self, attachment: bytes | None) -> bool:
        # An attachment ends with a gid, a hash of 128 bits.
        return attachment is not None and attachment[-16:] in self._gids

    def _all_routes(self) -> Iterator[BridgeRoute]:
        return itertools.chain.from_iterable(list(routes.values()) for routes in self._routes.values())

    def _close_routes(self) -> None:
        for kind, routes in self._routes.items():
            self._drop(kind, list(routes.values()))

    def _join(self) -> None:
        self.stop()
        self._wake()
        self._thread.join()

    def _finish(self) -> None:
        """Let messages that are under way pass."""
        for down in self._routes[DownRoute].values():
            down.unsubscribe()
        self._node.finish()

    def _problem(self, topic: str, text: str) -> None:
        self.report_problem(f"{topic}: {text}" if topic else text)

    def _losses(self) -> Counter[str]:
        found: Counter[str] = Counter()
        for topic, count in self._lost.copy().values():
            found[topic] += count
        return found

    def _refuse(self, topic: str) -> None:
        with self._changed:
            self._refused[topic] += 1
        self._problem(topic, "messages that are too short to be valid are left out")

    def _fail(self, text: str, hint: str | None) -> None:
        if self.failure is None:
            self.failure = EnvironmentFaultError(text, where="bridge", hint=hint)
        self.ended.set()


def summary_lines(status: Mapping[str, Any]) -> list[str]:
    """Return a table of what crossed."""
    topics, services, refused = status["topics"], status["services"], status["refused"]
    if not topics and not services:
        return ["there was nothing to bridge"]
    rows = [("", "to segment", "to domain")]
    rows += [(name, str(ways["to_segment"]), str(ways["to_domain"])) for name, ways in topics.items()]
    rows += [(name, f"{count} calls", "") for name, count in services.items()]
    return [
        *(f"{name}: {count} messages of the domain were lost" for name, count in status["lost"].items()),
        *(f"{name}: {count} messages too short to be valid were left out" for name, count in refused.items()),
        *table_lines(rows),
    ]
