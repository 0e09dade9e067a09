"""Sources of definitions that neither a log nor the user provides: a ROS installation, and rosbags' stores."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.given_files import given_text
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_ros2.common_services import ACTIONS, SERVICES
from riot_bus_ros2.definitions import KINDS, MOST_TEXT, DefinitionError, interface_of, parse_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.typesys.store import Typestore

    from riot_bus_ros2.definitions import Definition

    Source = Callable[[str], Definition | None]

HUMBLE = "ros2_humble"
"""The last distribution without hashes in keys."""
DISTROS = ("ros2_kilted", "ros2_lyrical")
OLDER = ("ros2_jazzy", "ros2_iron", HUMBLE)
_stores: dict[str, Typestore] = {}


def read_interface(file: Path, name: str) -> dict[str, Definition]:
    """Read the definitions in a file.

    Raises:
        ConfigError: It is too large, or no regular file.
        DefinitionError: The text does not parse.
    """
    return parse_file(given_text(file, most=MOST_TEXT), name, file.suffix)


def from_ament(name: str) -> Definition | None:
    """Return a definition from `AMENT_PREFIX_PATH`: of `share/pkg/msg/Name.msg`, or else `.idl`."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "")
    return _installed(prefixes, interface_of(name)).get(name) if prefixes else None


@lru_cache(maxsize=4096)
def _installed(prefixes: str, interface: str) -> Mapping[str, Definition]:
    package, _, rest = interface.partition("/")
    kind, _, short = rest.partition("/")
    if kind not in KINDS or not package.isidentifier() or not short.isidentifier():
        return {}
    for prefix in filter(None, prefixes.split(os.pathsep)):
        for suffix in (kind, "idl"):
            try:
                return read_interface(Path(prefix, "share", package, kind, f"{short}.{suffix}"), interface)
            except (OSError, UnicodeDecodeError, ConfigError, DefinitionError):
                continue
    return {}


def from_distribution(distro: str) -> Source:
    """Return one of rosbags' stores as a source."""
    return lambda name: rosbags_store(distro).fielddefs.get(name)


def rosbags_store(distro: str) -> Typestore:
    """Return a distribution's types; they must not be changed."""
    store = _stores.get(distro)
    if store is None:
        from rosbags.typesys import Stores, get_typestore

        store = _stores[distro] = get_typestore(Stores(distro))
    return store


def from_common_services(name: str) -> Definition | None:
    """Return a message of a service or action that every ROS installation has; rosbags has none of them."""
    return _common(interface_of(name)).get(name)


@lru_cache(maxsize=256)
def _common(interface: str) -> Mapping[str, Definition]:
    if interface in SERVICES:
        return parse_file(SERVICES[interface], interface, ".srv")
    return parse_file(ACTIONS[interface], interface, ".action") if interface in ACTIONS else {}
