"""Options of an agent, as plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from riot_bus.agent.names import check_robot
from riot_bus.config.endpoints import parse_endpoint
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

__all__ = ["PERMISSIONS", "AgentOptions"]

PERMISSIONS = ("play", "record")
"""What an agent may be allowed to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentOptions:
    """Options of an agent, and what it may do.

    Attributes:
        robot: Name of its robot.
        folder: Folder of its logs and recordings; it reads and writes nowhere else.
        endpoint: The router of the robot's own bus.
        fleet: The router through which it is commanded; None for that of its own bus.
        config: Further Zenoh configuration of clients of its own bus.
        fleet_config: Further Zenoh configuration of clients of the fleet's router.
        allow: Permissions that it has.
        catalogue: File that keeps what it knows of its logs; None to read them again at each start.
        keep_free: Bytes of the disk that recordings leave free.
    """

    robot: str
    folder: Path
    endpoint: str
    fleet: str | None = None
    config: Mapping[str, Any] = field(default_factory=dict)
    fleet_config: Mapping[str, Any] = field(default_factory=dict)
    allow: Sequence[str] = PERMISSIONS
    catalogue: Path | None = None
    keep_free: int = 1 << 29

    def check(self) -> None:
        """Raise ConfigError if a value cannot work."""
        check_robot(self.robot)
        parse_endpoint(self.endpoint, connect=True)
        parse_endpoint(self.commanded_at, connect=True)
        if not self.folder.is_dir():
            raise ConfigError(f"there is no folder {self.folder}", where="--logs", hint="create it first")
        for each in self.allow:
            if each not in PERMISSIONS:
                raise ConfigError(f"{each!r} cannot be allowed", where="--allow", hint=did_you_mean(each, PERMISSIONS))

    @property
    def commanded_at(self) -> str:
        """The router through which it is commanded."""
        return self.endpoint if self.fleet is None else self.fleet

    @property
    def commanded_with(self) -> Mapping[str, Any]:
        """Zenoh configuration for that router."""
        return self.fleet_config if self.fleet is not None or self.fleet_config else self.config
