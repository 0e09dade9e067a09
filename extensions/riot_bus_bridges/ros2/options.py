"""Options of `riot bridge ros2`, and the choice of bridged names."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import Flag
from riot_bus.vocabulary.selector import key_matches
from riot_bus_ros2.keys import action_of

_LARGEST_DOMAIN = 232  # DDS computes its ports from it
_LARGEST_ZENOH_DOMAIN = 999_999_999  # data keys have domains of up to nine digits (keys.py)
_MOST_KEPT = 1 << 20  # a million messages of 1 kB take 1 GB: more is probably a mistake
_OF_EVERY_NODE = frozenset(
    {
        "describe_parameters",
        "get_logger_levels",
        "get_parameter_types",
        "get_parameters",
        "get_type_description",
        "list_parameters",
        "set_logger_levels",
        "set_parameters",
        "set_parameters_atomically",
    }
)
_OF_ALL_NODES = frozenset({"/parameter_events", "/rosout"})


@dataclass(frozen=True, slots=True)
class Ros2BridgeOptions:
    """What to bridge: options of `riot bridge ros2`, declared here alone.

    Names of topics, services and nodes may contain `*` (one chunk) and `**` (any).
    """

    domain: Annotated[int, Flag("ROS_DOMAIN_ID of the nodes.", "-d", env="ROS_DOMAIN_ID")] = 0
    topics: Annotated[
        Sequence[str] | None,
        Flag(
            "Bridge only these topics or actions, such as '/camera/**'; repeatable. [default: all not hidden]",
            metavar="NAME",
        ),
    ] = None
    services: Annotated[
        Sequence[str] | None,
        Flag(
            "Bridge only these services or actions; repeatable. [default: all but those that every node has]",
            metavar="NAME",
        ),
    ] = None
    parameters: Annotated[
        Sequence[str],
        Flag("Let parameters of these nodes be set from the other side, too; repeatable.", metavar="NODE"),
    ] = ()
    exclude: Annotated[
        Sequence[str], Flag("Leave out these topics, services and actions; repeatable.", metavar="NAME")
    ] = ()
    zenoh_domain: Annotated[
        int, Flag("ROS_DOMAIN_ID in the keys on the segment; the same for bridges that are to meet.")
    ] = 0
    # DDS does not tell how many messages others keep
    depth: Annotated[int, Flag("Messages of each topic that the bridge keeps for slow peers.")] = 1000
    latched: Annotated[int, Flag("Messages of each latched topic that the bridge keeps for late joiners.")] = 100
    python: Annotated[
        str | None, Flag("Python that has rclpy. [default: the first on PATH]", "", "PYTHON", "RIOT_ROS_PYTHON")
    ] = None
    setup: Annotated[
        Path | None, Flag("File to source first, such as /opt/ros/jazzy/setup.bash.", "", "FILE", "RIOT_ROS_SETUP")
    ] = None

    def check(self) -> None:
        """Raise ConfigError if an option is not usable."""
        if not 0 <= self.domain <= _LARGEST_DOMAIN:
            hint = f"ROS_DOMAIN_ID is a number from 0 to {_LARGEST_DOMAIN}"
            raise ConfigError(f"{self.domain} is not a ROS domain", where="--domain", hint=hint)
        if not 0 <= self.zenoh_domain <= _LARGEST_ZENOH_DOMAIN:
            raise ConfigError(f"{self.zenoh_domain} is not a ROS domain", where="--zenoh-domain", hint="such as 0")
        for where, number in (("--depth", self.depth), ("--latched", self.latched)):
            if not 0 < number <= _MOST_KEPT:
                raise ConfigError(f"cannot keep {number} messages", where=where, hint=f"1 to {_MOST_KEPT}")
        named = {"--topics": self.topics, "--services": self.services, "--exclude": self.exclude}
        for where, names in {**named, "--parameters": self.parameters}.items():
            for name in names or ():
                if not name.startswith("/"):
                    raise ConfigError(f"{name!r} is not a full ROS name", where=where, hint=f"write it like /{name}")
        if self.setup is not None and not self.setup.is_file():
            raise ConfigError("no such file", where=f"--setup {self.setup}", hint="such as /opt/ros/jazzy/setup.bash")


class Names:
    """Which topics and services are bridged."""

    def __init__(self, options: Ros2BridgeOptions) -> None:
        self._topics, self._services, self._exclude = options.topics, options.services, options.exclude
        self._parameters = [f"{node}/set_parameters" for node in options.parameters]
        self._is_bridged = cache(self._choose)  # names are asked for again at each change of the graph

    def topic(self, name: str) -> bool:
        """Return whether a topic is bridged: by default all but hidden ones and those that every node has."""
        return self._is_bridged(name, service=False)

    def service(self, name: str) -> bool:
        """Return whether a service is bridged: by default all but hidden ones and those that every node has.

        The services and topics of actions are hidden, but bridged.
        """
        return self._is_bridged(name, service=True)

    def _choose(self, name: str, *, service: bool) -> bool:
        action = action_of(name)
        names = [name] if action is None else [name, action[0]]
        if _any_matches(self._exclude, names):
            return False
        if action is not None:  # an action is bridged as a whole
            lists = [each for each in (self._topics, self._services) if each is not None]
            return not lists or any(_any_matches(each, names) for each in lists)
        if service and _any_matches(self._parameters, names):
            return True
        wanted = self._services if service else self._topics
        if wanted is not None:
            return _any_matches(wanted, names)
        chunks = name.split("/")
        of_nodes = chunks[-1] in _OF_EVERY_NODE if service else name in _OF_ALL_NODES
        return not of_nodes and not any(chunk.startswith("_") for chunk in chunks)


def _any_matches(expressions: Sequence[str], names: Sequence[str]) -> bool:
    return any(key_matches(expression, name) for expression in expressions for name in names)
