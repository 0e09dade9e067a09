"""Keys of agents, and valid names of robots."""

from __future__ import annotations

import re
import socket

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session_config import OWN_CHUNK

UNDER = "agent/**"
"""The keys of an agent's commands, below the robot's own."""

ALL_AGENTS = f"{OWN_CHUNK}/*/agent/*"
"""The liveliness tokens of all agents."""

_NAME = re.compile(r"[A-Za-z0-9._-]{1,100}")


def agent_token(robot: str, zid: str) -> str:
    """Return the liveliness token by which an agent announces itself."""
    return f"{OWN_CHUNK}/{robot}/agent/{zid}"


def controller_key(robot: str, operation: str) -> str:
    """Return the key at which a controller proves that it is present."""
    return f"{OWN_CHUNK}/{robot}/agent/controller/{operation}"


def progress_key(robot: str) -> str:
    """Return the key at which an agent publishes the progress of its operation."""
    return f"{OWN_CHUNK}/{robot}/agent/progress"


def check_robot(name: str, where: str = "--robot") -> str:
    """Return the name; raises ConfigError if it is not valid for a robot."""
    if not _NAME.fullmatch(name):
        hint = f"letters, digits, '-', '_' and '.', at most 100: it is part of the key {OWN_CHUNK}/NAME/agent"
        raise ConfigError(f"{name[:120]!r} is not a name of a robot", where=where, hint=hint)
    return name


def default_robot() -> str:
    """Return this machine's name, changed where a robot's name cannot be so."""
    return re.sub(r"[^A-Za-z0-9._-]", "-", socket.gethostname())[:100] or "robot"
