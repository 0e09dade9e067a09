"""What participants of a bus announce by liveliness tokens: nodes, publishers, subscribers, services and actions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Announcement", "Announcing", "BridgedLink", "Role"]

Role = Literal["publishes", "subscribes", "serves", "calls"]


@dataclass(frozen=True, slots=True)
class Announcement:
    """What one liveliness token says.

    Attributes:
        zid: Id of the session that made it.
        role: What it announces; None for a node.
        key: Key or key expression; empty for a node.
        node: Full name of the node.
        topic: What people call the topic or service.
        type_name: Its type.
        source: `ros2 token`, `bridge token` or `advanced token`.
        action: The action that the topic or service belongs to, or that is announced itself.
        action_type: Type of that action, as far as the token tells.
    """

    zid: str
    role: Role | None
    key: str
    node: str
    topic: str
    type_name: str
    source: str
    action: str = ""
    action_type: str = ""


@dataclass(frozen=True, slots=True)
class BridgedLink:
    """A link of a bridge in the router's own process: to the bus, it is what is at its other end.

    Attributes:
        segment: Where it is.
        name: Its name.
        addresses: Where its other ends are.
        publishes: Keys of what came over it, and by which of the systems behind it.
        subscribes: Key expression of what can go out over it; empty if nothing can.
    """

    segment: str
    name: str
    addresses: tuple[str, ...] = ()
    publishes: Mapping[str, str] = field(default_factory=dict)
    subscribes: str = ""


@runtime_checkable
class Announcing(Protocol):
    """What an adapter can do besides `Adapter`, if participants of its middleware announce themselves.

    Attributes:
        announcements: Key expressions of their liveliness tokens.
    """

    announcements: Sequence[str]

    def announcement(self, token: str) -> Announcement | None:
        """Return what a token's key says, None if it is of another kind."""
        ...
