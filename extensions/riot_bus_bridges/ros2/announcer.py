"""Liveliness tokens: of the nodes of a domain on the segment, like those of rmw_zenoh, and of bridges."""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, NamedTuple

from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from riot_bus.types.port import Closeable
    from riot_bus_bridges.host.outer_port import OuterPort
    from riot_bus_bridges.ros2.plan import DomainAnnouncement
    from riot_bus_ros2.keys import DataKey
    from riot_bus_ros2.tokens import EndpointKind


_DOMAIN = re.compile("[0-9]{1,3}")


class OtherBridge(NamedTuple):
    """Another bridge, as described by its token."""

    domain: int
    zid: str
    name: str

    def token(self) -> str:
        """Return the last chunks of its token."""
        return f"{self.domain}/{self.zid}/{self.name}"

    @classmethod
    def parse(cls, token: str) -> OtherBridge | None:
        """Parse a token; return None if it is not the token of a bridge."""
        chunks = token.split("/")[-3:]  # domain, id of the session and name, see `token`
        if len(chunks) < 3 or not _DOMAIN.fullmatch(chunks[0]):
            return None
        return cls(int(chunks[0]), chunks[1], chunks[2])


class Announcer:
    """Declares tokens and undeclares them.

    Attributes:
        gids: Gids for the attachments of an endpoint's messages. rclpy does not say which of several publishers has
            sent a message, so the first stands for all.
    """

    def __init__(self, port: OuterPort, domain: int) -> None:
        self._port, self._domain = port, domain
        self.gids: dict[tuple[EndpointKind, DataKey], bytes] = {}
        self._shown: dict[DomainAnnouncement, tuple[str, Closeable]] = {}
        self._nodes: dict[str, int] = {}
        self._numbers = itertools.count(1)

    def update(self, wanted: Iterable[DomainAnnouncement], *, may_show: Callable[[DomainAnnouncement], bool]) -> None:
        """Declare the wanted tokens and no others."""
        present = {each for each in wanted if may_show(each)}
        for gone in [each for each in self._shown if each not in present]:
            self._shown.pop(gone)[1].close()
        for new in sorted(present.difference(self._shown), key=_order):
            token = self._token(new)
            self._shown[new] = (token, self._port.announce(token))
        gids: dict[tuple[EndpointKind, DataKey], bytes] = {}
        for each in sorted(self._shown, key=_order):
            if each.kind is not None and each.key is not None:
                gids.setdefault((each.kind, each.key), gid_of(self._shown[each][0]))
        self.gids = gids

    def close(self) -> None:
        """Undeclare all tokens."""
        self.update((), may_show=lambda each: False)

    def _token(self, what: DomainAnnouncement) -> str:
        if what.node not in self._nodes:
            self._nodes[what.node] = next(self._numbers)
        node = Node(self._domain, self._port.zid, self._nodes[what.node], what.node)
        if what.kind is None or what.key is None:
            return build_token(node)
        key = what.key
        return build_token(
            NodeEndpoint(node, next(self._numbers), what.kind, key.topic, key.type_name, key.type_hash, what.qos)
        )


def _order(each: DomainAnnouncement) -> tuple[bool, str, str, str, str]:
    """Return a sort key that puts nodes first."""
    return each.kind is not None, each.node, each.kind or "", each.key.topic if each.key else "", each.gid
