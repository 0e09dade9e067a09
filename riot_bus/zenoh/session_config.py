"""Configuration of Zenoh sessions: plain dictionaries of configuration keys and JSON values, for easy testing."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_files import endpoint_files

SessionConfig = dict[str, Any]
"""Configuration keys such as `listen/endpoints`, and their JSON values."""

OWN_CHUNK = "@riot"
"""First chunk of our own keys; being verbatim, it is not matched by wildcards."""

WAIT_BEFORE_CLOSE_S = 5.0
"""How long a BLOCK publication may wait for a slow receiver before Zenoh closes its transport (Zenoh's own default)."""

ANSWER_S = 2.0
"""How long to wait for answers to a query: one that comes at all comes at once, and one that hangs delays others."""

HEARTBEAT_S = 0.5
"""Period in which publishers tell their last number, as rmw_zenoh's do (SAMPLE_MISS_DETECTION_HEARTBEAT_PERIOD)."""

_CONTROL = b"riot ctl".hex()
_WAIT_BEFORE_CLOSE = "transport/link/tx/queue/congestion_control/block/wait_before_close"
_FLOWS = ["ingress"]  # one direction is enough, and each costs time for all messages on all links
_CACHES = ["put", "delete", "query", "reply", "declare_subscriber", "declare_queryable"]


def check_own_name(name: str, kind: str) -> None:
    """Raise ConfigError if a player or recorder cannot have this name, as part of its key."""
    if not name or not all(each.isalnum() or each in "-_." for each in name):
        hint = f"letters, digits, '-', '_' and '.': it is part of the key {OWN_CHUNK}/NAME/{kind}"
        raise ConfigError(f"{name!r} is not a name", where="--name", hint=hint)


def router_config(
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
    extra: Mapping[str, Any] | None = None,
) -> SessionConfig:
    """Return the configuration of a router session."""
    return {
        "mode": "router",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/delay": 0,  # opening takes 2 ms instead of 508 ms
        "scouting/multicast/enabled": False,  # else peers on one host find each other around every router
        "adminspace/enabled": True,
        "transport/shared_memory/enabled": False,  # each session would leave a file in /dev/shm open for ever
        _WAIT_BEFORE_CLOSE: int(wait_before_close_s * 1e6),
        **(extra or {}),
    }


def client_config(endpoint: str, *, extra: Mapping[str, Any] | None = None) -> SessionConfig:
    """Return the configuration of a client of one router.

    Args:
        endpoint: Endpoint on which the router listens; paths behind its `#` start from the working folder.
        extra: Further keys; they win.

    Raises:
        ConfigError: As for `endpoint_files`.
    """
    if "_file=" in endpoint or "private_key" in endpoint:
        endpoint = endpoint_files(endpoint, Path.cwd(), where="endpoint")
    return {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/delay": 0,
        "scouting/multicast/enabled": False,
        **(extra or {}),
    }


def control_id() -> str:
    """Return a new id for a session that controls a router; such sessions are not components."""
    return f"{_CONTROL}{os.urandom(8).hex()}"


def is_control(zid: str) -> bool:
    """Return whether an id was made by `control_id`."""
    return zid.startswith(_CONTROL)


def access_control(
    cut: Sequence[str],
    *,
    services: Sequence[str] = (),
    tokens: Sequence[str] | None = None,
    peers: Sequence[str] | None = None,
) -> SessionConfig:
    """Return the access rules by which a router rejects over its links what has to stay in another segment.

    Subscriptions to the cut keys are rejected too: segments then do not send what would be rejected anyway. Queries to
    the router itself stay in their segment, so that each is answered once, and only where control is allowed; otherwise
    a query would be forwarded to every segment.

    Args:
        cut: Key expressions that are intercepted.
        services: Key expressions of services whose requests and replies are intercepted.
        tokens: Key expressions of liveliness tokens that must not cross either; by default those of all advanced
            publishers on cut keys.
        peers: Ids of the sessions to whose links the rules apply; by default all.
    """
    tokens = [f"{key}/@adv/pub/**" for key in cut] if tokens is None else tokens
    rules = [{"id": "control", "messages": ["query", "reply", "declare_queryable"], "key_exprs": [f"{OWN_CHUNK}/**"]}]
    if cut:
        rules += [
            {"id": "cut", "messages": ["put", "delete", "declare_subscriber"], "key_exprs": list(cut)},
            # `**` does not match the verbatim chunk `@adv`, behind which advanced publishers keep their caches. These
            # end here, heartbeats and tokens too; tokens of advanced subscribers pass. Replies on the keys themselves
            # pass as well, else services that are not selected would not work.
            {"id": "cut-caches", "messages": _CACHES, "key_exprs": [f"{key}/@adv/**" for key in cut]},
        ]
    if services:
        messages = ["query", "reply", "declare_queryable"]
        rules.append({"id": "cut-services", "messages": messages, "key_exprs": list(services)})
    if tokens:
        rules.append({"id": "cut-tokens", "messages": ["liveliness_token"], "key_exprs": list(tokens)})
    return {
        "access_control": {
            "enabled": True,
            "default_permission": "allow",
            "rules": [{**rule, "permission": "deny", "flows": _FLOWS} for rule in rules],
            "subjects": [{"id": "peers"} if peers is None else {"id": "peers", "zids": list(peers)}],
            "policies": [{"rules": [rule["id"] for rule in rules], "subjects": ["peers"]}],
        }
    }
