"""`riot init`: a first riot.toml from a live network, or from a recording."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.sut.plain_draft import plain_draft
from riot_bus.sut.scaffold import draft_json, draft_toml
from riot_bus.sut.system import SystemFile
from riot_bus.types.capabilities import ListensToLinks
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.redaction import redacted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from riot_bus.sut.command_draft import CommandDraft
    from riot_bus.sut.plain_draft import PlainDraft, PlainFacts
    from riot_bus.types.capabilities import HeardSystem

__all__ = ["check_path", "init_links", "init_plain", "init_plain_log", "init_ros2", "write_system"]


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
        EnvironmentFaultError: No router answers, or no nodes were seen.
    """
    from riot_bus.control.component import client_cfg
    from riot_bus.graph.survey import survey
    from riot_bus.sut.process_facts import bridged_domain, nodes_of_domain
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


def init_plain(
    path: Path,
    endpoint: str,
    *,
    seconds: float,
    record: Path | None = None,
    start: bool = False,
    unit: str | None = None,
    external: Sequence[str] = (),
    router: str | None = None,
    cfg: Sequence[str] = (),
    force: bool = False,
) -> dict[str, Any]:
    """Look at the components on a router and write a system file.

    Args:
        path: Path of the system file.
        endpoint: Endpoint of the router.
        seconds: Time to look, in seconds.
        record: Path at which the messages are recorded as the nominal log; None for no recording.
        start: Whether to start the components once, apart from those that run, to see what each reads and writes.
        unit: Name of the component to test.
        external: Components that play the outside world.
        router: Name of the router, if there are several.
        cfg: Further Zenoh settings, each `KEY=VALUE`.
        force: Whether to replace existing files.

    Returns:
        What was seen and written, as JSON values.

    Raises:
        ConfigError: A file exists already, or a named component was not seen.
        EnvironmentFaultError: No router answers, or nothing was seen.
    """
    from riot_bus.control.component import client_cfg
    from riot_bus.sut.plain_look import look_at_network

    check_path(path, force=force)
    if record is not None and record.exists() and not force:
        raise ConfigError("there is a recording already", where=str(record), hint="name another, or use --force")
    config = client_cfg(cfg)
    facts = look_at_network(endpoint, seconds=seconds, record=record, config=config, router=router, force=force)
    try:
        inside = {zid: replace(each, cwd=_relative(Path(each.cwd), path)) for zid, each in facts.commands.items()}
        facts = replace(facts, commands=inside)
        found = plain_draft(facts, unit=unit, external=external)
        _write_files(path.resolve().parent, facts.commands.values(), force=force)
        origin = f"what {redacted(endpoint)} showed within {seconds:g} s"
        _write(path, found, origin, record, force=force)
    except RiotError:
        if record is not None:  # else a second attempt would be refused because of it
            record.unlink(missing_ok=True)
        raise
    if start:
        found = _started(path, facts, found, seconds, unit=unit, external=external)
        _write(path, found, f"{origin}, and what its components did when riot started them", record, force=True)
    return {"file": str(path), "endpoint": redacted(endpoint), "started": start, **draft_json(found)}


def init_plain_log(
    path: Path, log: Path, *, unit: str | None = None, external: Sequence[str] = (), force: bool = False
) -> dict[str, Any]:
    """Write a system file from a recording; arguments, result and errors as of `init_plain`."""
    check_path(path, force=force)
    from riot_bus.sut.plain_look import look_at_log

    found = plain_draft(look_at_log(log), unit=unit, external=external)
    _write(path, found, f"what {log.name} shows", log, force=force)
    return {"file": str(path), "log": str(log), "started": False, **draft_json(found)}


def _write(path: Path, found: PlainDraft, origin: str, nominal: Path | None, *, force: bool) -> None:
    name = path.resolve().parent.name or "system"
    text = draft_toml(found, origin=origin, name=name, nominal=None if nominal is None else _relative(nominal, path))
    write_system(path, text, force=force)


def _write_files(folder: Path, commands: Iterable[CommandDraft], *, force: bool) -> None:
    """Write the files of components that have {endpoint} in place of the endpoint to connect to."""
    texts = {folder / name: text for command in commands for name, text in command.files.items()}
    there = [path for path, text in texts.items() if path.exists() and path.read_text(encoding="utf-8") != text]
    if there and not force:
        raise ConfigError("there is such a file already", where=str(there[0]), hint="use --force to replace it")
    for path, text in texts.items():
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write a file of a component: {error.strerror}", where=str(path)) from error


def _relative(place: Path, path: Path) -> str:
    """Return a path as the system file has it: from its folder, if it is inside of that."""
    root, place = path.resolve().parent, place.resolve()
    return os.path.relpath(place, root) if place.is_relative_to(root) else str(place)


def _started(
    path: Path, facts: PlainFacts, found: PlainDraft, seconds: float, *, unit: str | None, external: Sequence[str]
) -> PlainDraft:
    """Return the draft with what components do when they are started."""
    from riot_bus.sut.context import open_system
    from riot_bus.sut.first_run import first_run, with_run

    names = [name for name, command in found.commands.items() if command.can_start]
    if not names:
        raise ConfigError(
            "no component can be started, since no command is known completely",
            where=str(path),
            hint="fill in the commands, with {endpoint} in each",
        )
    run = first_run(open_system(path), names, keys=facts.topics, seconds=seconds)
    return plain_draft(with_run(facts, run, found.sessions), unit=unit, external=external, names=found.sessions)
