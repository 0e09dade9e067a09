"""`riot init`: a first riot.toml from a live network."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any

from riot_bus.sut.system import SystemFile
from riot_bus.types.capabilities import ListensToLinks
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.redaction import redacted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from riot_bus.types.capabilities import HeardSystem

__all__ = ["check_path", "init_links", "init_ros2", "write_system"]


def init_ros2(
    path: Path,
    endpoint: str,
    *,
    seconds: float,
    unit: str | None = None,
    external: Sequence[str] = (),
    cfg: Sequence[str] = (),
    force: bool = False,
) -> dict[str, Any]:
    """Look at the ROS 2 nodes on a router and write a system file.

    Args:
        path: Path of the system file.
        endpoint: Endpoint of the router.
        seconds: Time to look, in seconds.
        unit: Name of the node to test.
        external: Nodes that play the outside world.
        cfg: Further Zenoh settings, each `KEY=VALUE`.
        force: Whether to replace an existing file.

    Returns:
        What was seen and written, as JSON values.

    Raises:
        ConfigError: The file exists already, or a named node was not seen.
        EnvironmentFaultError: Nobody answers, or no nodes were seen.
    """
    from riot_bus.control.component import client_cfg
    from riot_bus.graph.survey import survey
    from riot_bus.sut.dds_nodes import bridged_domain, nodes_of_domain
    from riot_bus.sut.scaffold import sketch_json, sketch_toml
    from riot_bus.sut.system_draft import sketch

    check_path(path, force=force)
    registry = TypeRegistry(load_adapters(["ros2"]))
    seen = survey(endpoint, registry, seconds=seconds, config=client_cfg(cfg))
    shown = redacted(endpoint)
    domains = {zid: bridged_domain(each) for zid, each in seen.started.items()}
    found = sketch(
        seen.announcements,
        offered=seen.offered,
        known=lambda name: registry.type_named(name) is not None,
        unit=unit,
        external=external,
        started=seen.started,
        behind={zid: nodes_of_domain(domain) for zid, domain in domains.items() if domain is not None},
        where=shown,
    )
    write_system(path, sketch_toml(found, origin=f"what {shown} announced within {seconds:g} s"), force=force)
    return {"file": str(path), "endpoint": shown, "skipped": seen.skipped, **sketch_json(found)}


def init_links(
    path: Path,
    adapter: str,
    links: Sequence[str],
    *,
    seconds: float,
    unit: str | None = None,
    force: bool = False,
    warn: Callable[[str], None],
) -> HeardSystem:
    """Listen to links that an adapter knows and write a system file.

    Args:
        path: Path of the system file.
        adapter: Name of the adapter.
        links: Links in the notation of the adapter.
        seconds: Time to listen, in seconds.
        unit: Name of the unit to test, as the adapter names it.
        force: Whether to replace an existing file.
        warn: Function called with a line about what does not work.

    Returns:
        What was heard and written.

    Raises:
        ConfigError: The file exists already, the adapter cannot listen to links, or a link or the unit is wrong.
        EnvironmentFaultError: A link cannot be opened, or nothing was heard.
    """
    (loaded,) = load_adapters([adapter])
    if not isinstance(loaded, ListensToLinks):
        hint = "it needs `listen` of riot_bus.types.capabilities.ListensToLinks"
        raise ConfigError(f"adapter {adapter!r} hears no systems on links", where="riot init", hint=hint)
    check_path(path, force=force)
    found = loaded.listen(links, seconds=seconds, unit=unit, warn=warn)
    write_system(path, found.toml, force=force)
    return found


def check_path(path: Path, *, force: bool) -> None:
    """Raise ConfigError if the system file exists, unless `force`."""
    if path.exists() and not force:
        raise _there(path)


def write_system(path: Path, text: str, *, force: bool) -> None:
    """Write a system file.

    Args:
        path: Path of the system file.
        text: Text of a valid system file.
        force: Whether to replace an existing file.

    Raises:
        ConfigError: The file exists already, or cannot be written.
    """
    SystemFile.model_validate({**tomllib.loads(text), "path": path.resolve()})
    try:
        with path.open("w" if force else "x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise _there(path) from None
    except OSError as error:
        raise ConfigError(f"cannot write the system file: {error.strerror}", where=str(path)) from error


def _there(path: Path) -> ConfigError:
    return ConfigError("there is a system file already", where=str(path), hint="name another with -o, or use --force")
