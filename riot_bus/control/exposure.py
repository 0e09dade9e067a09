"""Warnings about listeners of a router or a bridge that are open to the network."""

from __future__ import annotations

from collections.abc import Iterable

from riot_bus.config.endpoints import ENCRYPTED, Endpoint
from riot_bus.config.router_settings import RouterSettings, SegmentSettings
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.config_files import USERS


def exposure_warnings(settings: RouterSettings) -> list[str]:
    """Return one line per listener that every host of the network can use, reading and writing every key.

    Loopback and socket files are not reachable from outside. Elsewhere TLS or QUIC, user names with passwords, or
    access control count as a deliberate choice.
    """
    cure = ", or configure TLS, users or access control (docs/router.md)"
    return [
        _told(f"segment {name!r}", endpoint, cure)
        for name, segment in settings.segments.items()
        if not _controlled(segment)
        for endpoint in segment.listeners
        if not endpoint.is_local and endpoint.protocol not in ENCRYPTED
    ]


def bridge_warnings(listens: Iterable[str]) -> list[str]:
    """Return one line per endpoint of a bridge's links that every host of the network can use."""
    endpoints = [Endpoint(*text.split("/", 1)) for text in listens]
    return [_told("a link", each, "") for each in endpoints if not each.is_local]


def _told(what: str, endpoint: Endpoint, cure: str) -> str:
    reached = "any host that reaches it can read and write everything"
    return f"{what} listens on {redacted(str(endpoint))}: {reached}; use 127.0.0.1{cure}"


def _controlled(segment: SegmentSettings) -> bool:
    control = segment.config.get("access_control")
    enabled = segment.config.get("access_control/enabled") or (isinstance(control, dict) and control.get("enabled"))
    return bool(enabled or segment.config.get(f"{USERS}/dictionary_file"))
