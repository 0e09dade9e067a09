"""Options of an agent: declared here for `riot agent`, and plain values for its service."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from riot_bus.config.arguments import DEFAULT_ENDPOINT, parse_size
from riot_bus.config.endpoints import parse_endpoint
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.flags import Flag
from riot_bus_fleet.agent.names import check_robot, default_robot

PERMISSIONS = ("play", "record")
"""What an agent may be allowed to do."""


def _zenoh_settings(texts: Sequence[str], where: str) -> dict[str, Any]:
    from riot_bus.control.component import client_cfg  # loads Zenoh's configuration

    return client_cfg(texts, where=where)


_POLICIES = ("continue", "pause", "stop")


def _policy(text: str, where: str) -> str:
    if text not in _POLICIES:
        raise ConfigError(f"unknown policy {text!r}", where=where, hint=f"choose one of {', '.join(_POLICIES)}")
    return text


def _permissions(texts: Sequence[str], where: str) -> Sequence[str]:
    return () if list(texts) == ["nothing"] else texts


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentOptions:
    """Options of an agent, and what it may do."""

    folder: Annotated[
        Path,
        Flag("Folder of the robot's logs; no others are read or written.", "--logs", "FOLDER", "RIOT_AGENT_LOGS"),
    ]
    robot: Annotated[str, Flag("Name of this robot. [default: this machine's name]", "", "NAME", "RIOT_ROBOT")] = field(
        default_factory=default_robot
    )
    endpoint: Annotated[str, Flag("Router of the robot's bus.", "-e", "ENDPOINT", "RIOT_ENDPOINT")] = DEFAULT_ENDPOINT
    fleet: Annotated[
        str | None,
        Flag(
            "The fleet's router, through which commands come. [default: that of the robot's bus]",
            "",
            "ENDPOINT",
            "RIOT_FLEET",
        ),
    ] = None
    config: Annotated[
        Mapping[str, Any],
        Flag(
            "A Zenoh setting for connections to the robot's bus; KEY=@FILE for passwords; repeatable.",
            "--cfg",
            "KEY=VALUE",
            "RIOT_CLIENT_CFG",
            _zenoh_settings,
        ),
    ] = field(default_factory=dict)
    fleet_config: Annotated[
        Mapping[str, Any],
        Flag(
            "A Zenoh setting for the connection to the fleet's router; KEY=@FILE for passwords; repeatable.",
            "--fleet-cfg",
            "KEY=VALUE",
            "RIOT_FLEET_CFG",
            _zenoh_settings,
        ),
    ] = field(default_factory=dict)
    allow: Annotated[
        Sequence[str],
        Flag(
            "What this agent may do; repeatable. [default: play and record]",
            metavar="play|record|nothing",
            read=_permissions,
        ),
    ] = PERMISSIONS
    catalogue: Annotated[
        Path | None,
        Flag(
            "File to keep what is known of the logs, so that they are not read again at each start.",
            "",
            "FILE",
            "RIOT_AGENT_CATALOGUE",
        ),
    ] = None
    keep_free: Annotated[
        int, Flag("Disk space that recordings leave free.", metavar="SIZE", read=parse_size, text="512MiB")
    ] = 1 << 29

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerOptions:
    """Options of a command that starts an operation on a robot and follows it."""

    on_lost_controller: Annotated[
        str | None,
        Flag("What the robot does when this command is lost.", metavar="continue|pause|stop", read=_policy),
    ] = None
    grace: Annotated[
        float,
        Flag("Time without contact after which this command counts as lost.", metavar="SECONDS", least=0.0),
    ] = 10.0
    detach: Annotated[bool, Flag("Return once it has begun; it is not watched then.")] = False
    give_up: Annotated[
        float,
        Flag("Give up when nothing was heard of the robot for this long.", metavar="SECONDS", least=0.0),
    ] = 60.0
    endpoint: Annotated[str, Flag("The fleet's router.", "-e", "ENDPOINT", "RIOT_FLEET")] = DEFAULT_ENDPOINT
    config: Annotated[
        Mapping[str, Any],
        Flag(
            "A Zenoh setting of this client, such as a certificate; KEY=@FILE for passwords; repeatable.",
            "--cfg",
            "KEY=VALUE",
            "RIOT_CLIENT_CFG",
            _zenoh_settings,
        ),
    ] = field(default_factory=dict)

    def policy(self, default: str) -> dict[str, Any]:
        """Return what a robot does without its controller; raises ConfigError if no controller stays."""
        chosen = self.on_lost_controller
        if self.detach and chosen not in (None, "continue"):
            hint = "leave one of them out: with --detach there is no controller to be lost"
            raise ConfigError(f"--detach and --on-lost-controller {chosen} exclude each other", hint=hint)
        return {"on_lost_controller": "continue" if self.detach else chosen or default, "grace": self.grace}
