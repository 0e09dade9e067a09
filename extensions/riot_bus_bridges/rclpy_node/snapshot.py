"""The graph of a ROS domain as one of its nodes sees it: nodes, and their publishers, subscriptions and services."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any

from .frames import NODE_PREFIX
from .kinds import type_hash
from .profiles import numbers_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.node import Node

_UNKNOWN = ("_NODE_NAME_UNKNOWN_", "_CREATED_BY_BARE_DDS_APP_")
_PATIENCE_S = 1.0  # the name of a node may be known later than its endpoints


class GraphSnapshot:
    """Looks at the graph."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._nameless: dict[str, float] = {}

    def look(self) -> dict[str, Any]:
        """Return the graph, with only the names of bridges."""
        names = [_full(name, namespace) for name, namespace in self._node.get_node_names_and_namespaces()]
        topics = sorted(self._node.get_topic_names_and_types())
        nameless: dict[str, float] = {}
        publishers = list(self._endpoints(topics, self._node.get_publishers_info_by_topic, nameless))
        subscriptions = list(self._endpoints(topics, self._node.get_subscriptions_info_by_topic, nameless))
        self._nameless = nameless
        nodes = sorted({name for name in names if not _is_bridge(name)})
        return {
            "bridges": sorted({name for name in names if _is_bridge(name)}),
            "nodes": nodes,
            "publishers": publishers,
            "subscriptions": subscriptions,
            "servers": list(self._services(nodes, self._node.get_service_names_and_types_by_node)),
            "clients": list(self._services(nodes, self._node.get_client_names_and_types_by_node)),
        }

    def _endpoints(
        self, topics: list[Any], ask: Callable[[str], Any], nameless: dict[str, float]
    ) -> Iterator[list[Any]]:
        for topic, _ in topics:
            found = []
            for each in ask(topic):
                name = each.node_name
                gid = bytes(each.endpoint_gid).hex()
                if name in _UNKNOWN:
                    now = time.monotonic()
                    nameless[gid] = self._nameless.get(gid, now)
                    if now - nameless[gid] < _PATIENCE_S:
                        continue
                    name, node = "", ""
                else:
                    node = _full(name, each.node_namespace)
                if not _is_bridge(node):
                    hashed = str(getattr(each, "topic_type_hash", ""))
                    hashed = hashed if hashed.startswith("RIHS") else type_hash(each.topic_type)
                    found.append([node, topic, each.topic_type, hashed, numbers_of(each.qos_profile), gid])
            yield from sorted(found)

    def _services(self, nodes: list[str], ask: Callable[[str, str], Any]) -> Iterator[list[Any]]:
        for node in nodes:
            namespace, _, name = node.rpartition("/")
            services: Any = ()
            with contextlib.suppress(Exception):  # the node has gone; each rclpy has its own error for that
                services = ask(name, namespace or "/")
            for service, types in sorted(services):
                yield from ([node, service, each, type_hash(each)] for each in sorted(types))


def _full(name: str, namespace: str) -> str:
    return f"{namespace.rstrip('/')}/{name}"


def _is_bridge(node: str) -> bool:
    return node.rpartition("/")[2].startswith(NODE_PREFIX)
