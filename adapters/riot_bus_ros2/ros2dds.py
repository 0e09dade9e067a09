"""Names, tokens and attachments of zenoh-bridge-ros2dds, which joins DDS systems of ROS 2 to Zenoh.

A key is the bridge's namespace, if any, followed by the name of a topic, service or action without its first slash:
no domain, type or hash. Liveliness tokens announce the types:

    @/<zid>/@ros2_lv/<MP|MS>/<key>/<type>/[K]:<reliability>:<durability>:<history>,<depth>[:<user data>]
    @/<zid>/@ros2_lv/<SS|SC|AS|AC>/<key>/<type>

Slashes in keys and types are written as `§`; numbers are those of DDS; messages have no attachment. Source:
liveliness_mgt.rs, ros2_utils.rs and route_service_srv.rs of eclipse-zenoh/zenoh-plugin-ros2dds.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import Literal, get_args

from riot_bus_ros2.qos import Durability, HistoryPolicy, Reliability, RosQos

TOKENS = "@/*/@ros2_lv/**"
"""Key expression of the tokens of all bridges."""

BridgeTokenKind = Literal["MP", "MS", "SS", "SC", "AS", "AC"]
"""Publisher, subscriber, service server, service client, action server, action client."""

_KINDS: dict[str, BridgeTokenKind] = {kind: kind for kind in get_args(BridgeTokenKind)}
_WITH_QOS = ("MP", "MS")
_TOKEN = re.compile(r"@/(?P<zid>[0-9a-f]{1,32})/@ros2_lv/(?P<kind>[A-Z]{2})/(?P<key>[^/]+)/(?P<type>[^/]+)(?:/(.+))?")
_NUMBER = re.compile(r"[0-9]{1,10}", re.ASCII)
_HASH = re.compile(r"typehash=(RIHS[0-9]{2}_[0-9a-f]+)")


def key_of(name: str, namespace: str = "/") -> str:
    """Return the key of a full ROS name.

    Example:
        >>> key_of("/cmd_vel", "/bot1")
        'bot1/cmd_vel'
    """
    return f"{namespace.rstrip('/')}{name}"[1:]


def name_of(key: str, namespace: str = "/") -> str:
    """Return the full ROS name of a key; keys outside of the namespace keep all their chunks."""
    return f"/{key.removeprefix(f'{namespace}/'.lstrip('/'))}"


@dataclass(frozen=True, slots=True)
class BridgeQos:
    """Quality of service in a token, with the numbers of DDS; None where the token does not give it.

    Attributes:
        keyed: Whether the DDS topic has a key; topics of ROS 2 have none.
        reliability: 0 best effort, 1 reliable.
        durability: 0 volatile, 1 transient local.
        history: 0 keep last, 1 keep all.
        depth: Depth of the history, given only together with it.
        user_data: User data of DDS, such as `typehash=RIHS01_...;`.
    """

    keyed: bool = False
    reliability: int | None = None
    durability: int | None = None
    history: int | None = None
    depth: int | None = None
    user_data: str = ""

    @classmethod
    def parse(cls, text: str) -> BridgeQos | None:
        """Parse the last chunk of a token; return None if it is not valid."""
        parts = text.split(":", 4)
        history, _, depth = parts[3].partition(",") if len(parts) > 3 else ("", "", "")
        numbers = [*parts[1:3], history, depth]
        if len(parts) < 4 or parts[0] not in ("", "K") or bool(history) != bool(depth):
            return None
        if any(each and _NUMBER.fullmatch(each) is None for each in numbers):
            return None
        reliability, durability, kind, kept = (int(each) if each else None for each in numbers)
        return cls(bool(parts[0]), reliability, durability, kind, kept, parts[4] if len(parts) > 4 else "")

    def token(self) -> str:
        """Return the chunk of a token."""
        history = "" if self.history is None else f"{self.history},{self.depth}"
        parts = ["K" if self.keyed else "", _text(self.reliability), _text(self.durability), history]
        return ":".join([*parts, self.user_data] if self.user_data else parts)

    @property
    def type_hash(self) -> str | None:
        """Hash of the type; none before Iron."""
        match = _HASH.search(self.user_data)
        return None if match is None else match[1]

    @property
    def announced(self) -> RosQos:
        """The same QoS with rmw's numbers; missing values are the defaults of a DDS writer."""
        return RosQos(
            reliability=Reliability.BEST_EFFORT if self.reliability == 0 else Reliability.RELIABLE,
            durability=Durability.LATCHED if self.durability else Durability.VOLATILE,
            history=HistoryPolicy.KEEP_ALL if self.history == 1 else HistoryPolicy.KEEP_LAST,
            depth=1 if self.depth is None else self.depth,
        )

    @classmethod
    def of(cls, qos: RosQos, *, type_hash: str | None = None) -> BridgeQos:
        """Return what a bridge would announce for a publisher of ROS 2."""
        return cls(
            reliability=0 if qos.reliability == Reliability.BEST_EFFORT else 1,
            durability=int(qos.latched),
            history=int(qos.keep_all),
            depth=qos.depth,
            user_data=f"typehash={type_hash};" if type_hash else "",
        )


def _text(number: int | None) -> str:
    return "" if number is None else str(number)


@dataclass(frozen=True, slots=True)
class BridgeToken:
    """Announcement of a bridge for a node behind it.

    Attributes:
        key: Key of its messages; for an action, the common beginning of its five keys.
    """

    zid: str
    kind: BridgeTokenKind
    key: str
    type_name: str
    qos: BridgeQos | None = None


def parse_bridge_token(token: str) -> BridgeToken | None:
    """Return what a bridge announces, None if this is not a token of a bridge.

    Example:
        >>> parse_bridge_token("@/3f/@ros2_lv/MP/bot1§odom/nav_msgs§msg§Odometry/:1:0:0,10").key
        'bot1/odom'
    """
    match = _TOKEN.fullmatch(token)
    if match is None or match["kind"] not in _KINDS:
        return None
    zid, kind, key, type_name, rest = match.groups()
    qos = BridgeQos.parse(rest) if rest is not None else None
    if (kind in _WITH_QOS) != (qos is not None):
        return None
    return BridgeToken(zid, _KINDS[kind], key.replace("§", "/"), type_name.replace("§", "/"), qos)


def build_bridge_token(token: BridgeToken) -> str:
    """Return the token that `parse_bridge_token` reads."""
    chunks = ["@", token.zid, "@ros2_lv", token.kind, token.key.replace("/", "§"), token.type_name.replace("/", "§")]
    return "/".join([*chunks, token.qos.token()] if token.qos is not None else chunks)


def request_attachment() -> bytes:
    """Return the attachment of a service's first request from a new client, by which the reply finds its client.

    It is `rqh`, 8 bytes for the id of the DDS client, the number of the request in the payload's byte order, and
    whether that is little-endian.
    """
    return b"rqh" + os.urandom(8) + (1).to_bytes(8, "little") + b"\1"
