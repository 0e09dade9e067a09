"""Announcements by liveliness tokens: those that adapters understand, and those of zenoh-ext's advanced pub/sub."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from riot_bus.types.capabilities import Announcement

if TYPE_CHECKING:
    from riot_bus.types.capabilities import Role
    from riot_bus.types.registry import TypeRegistry

ADVANCED = "**/@adv/**"
"""Keys of the tokens of advanced publishers and subscribers. `@...` chunks are verbatim: no `**` matches them."""

_ROLES: dict[str, Role] = {"pub": "publishes", "sub": "subscribes"}
_TOKEN = re.compile(r"(?P<key>.+)/@adv/(?P<role>pub|sub)/(?P<zid>[0-9a-f]+)/[^/]+(?:/.*)?")


def expressions(registry: TypeRegistry) -> list[str]:
    """Return the key expressions of all tokens that `parse_token` understands."""
    return [*registry.announcements(), ADVANCED]


def parse_token(token: str, registry: TypeRegistry) -> Announcement | None:
    """Return what a liveliness token announces, None if it is not known.

    Example:
        >>> from riot_bus.types.registry import TypeRegistry
        >>> parse_token("0/a/@adv/pub/3f2a/uhlc/_", TypeRegistry()).role
        'publishes'
    """
    match = _TOKEN.fullmatch(token)
    if match is None:
        return registry.announcement(token)
    return Announcement(match["zid"], _ROLES[match["role"]], match["key"], "", "", "", "advanced token")
