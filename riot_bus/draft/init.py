"""`riot init`: a first riot.toml from a live network, running processes, or a recording."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.draft.graph_draft import graph_draft
from riot_bus.draft.model import CommandDraft
from riot_bus.draft.writing import draft_json, draft_toml
from riot_bus.plugins import LISTENERS
from riot_bus.system.system_file import SystemFile
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.redaction import redacted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from riot_bus.draft.graph_draft import Seen
    from riot_bus.draft.init_options import InitOptions
    from riot_bus.draft.model import SystemDraft
    from riot_bus.types.capabilities import HeardSystem, ListensToLinks


def init_nodes(options: InitOptions) -> dict[str, Any]:
    """Look at the ROS 2 nodes on a router and write a system file; return what was seen and written, as JSON values.

    Raises:
        ConfigError: The file exists already, or a named node was not seen.
        EnvironmentFaultError: No router answers, or no nodes were seen.
    """
    from riot_bus.draft.nodes_draft import nodes_draft
    from riot_bus.draft.process_facts import bridged_domain, nodes_of_domain
    from riot_bus.graph.survey import survey

    check_path(options.out, force=options.force)
    registry = TypeRegistry(load_adapters(["ros2"]))
    seen = survey(options.endpoint, registry, seconds=options.seconds, config=options.config)
    shown = redacted(options.endpoint)
    domains = {zid: bridged_domain(each) for zid, each in seen.started.items()}
    found = nodes_draft(
        seen.announcements,
        offered=seen.offered,
        known=lambda name: registry.type_named(name) is not None,
        unit=options.unit,
        external=options.external,
        started={zid: CommandDraft(each.command, each.cwd, pid=each.pid) for zid, each in seen.started.items()},
        behind={zid: nodes_of_domain(domain) for zid, domain in domains.items() if domain is not None},
        where=shown,
    )
    text = draft_toml(found, origin=f"what {shown} announced within {options.seconds:g} s", name="ros2")
    write_system(options.out, text, force=options.force)
    return {"file": str(options.out), "endpoint": shown, "skipped": seen.skipped, **draft_json(found)}


def init_links(options: InitOptions, adapter: str, links: Sequence[str], *, warn: Callable[[str], None]) -> HeardSystem:
    """Listen to links that an adapter knows, in its notation, and write a system file.

    The unit is named as the adapter names it; `warn` is called with a line about what does not work.

    Raises:
        ConfigError: The file exists already, the adapter cannot listen to links, or a link or the unit is wrong.
        EnvironmentFaultError: A link cannot be opened, or nothing was heard.
    """
    (loaded,) = load_adapters([adapter])
    listener: ListensToLinks = LISTENERS.load(loaded.name, where="riot init --link")(loaded)
    check_path(options.out, force=options.force)
    found = listener.listen(links, seconds=options.seconds, unit=options.unit, warn=warn)
    write_system(options.out, found.toml, force=options.force)
    return found


def init_network(options: InitOptions) -> dict[str, Any]:
    """Look at the components on a router, start them if that was asked for, and write a system file, as `init_nodes`.

    Raises:
        ConfigError: A file exists already, or a named component was not seen.
        EnvironmentFaultError: No router answers, or nothing was seen.
    """
    from riot_bus.draft.network import look_at_network

    path, record = options.out, options.record
    check_path(path, force=options.force)
    if record is not None and record.exists() and not options.force:
        raise ConfigError("there is a recording already", where=str(record), hint="name another, or use --force")
    seen = look_at_network(options)
    origin = f"what {redacted(options.endpoint)} showed within {options.seconds:g} s"
    try:
        inside = {zid: replace(each, cwd=_relative(Path(each.cwd), path)) for zid, each in seen.commands.items()}
        seen = replace(seen, commands=inside)
        found = graph_draft(seen, unit=options.unit, external=options.external)
        _write_files(path.resolve().parent, seen.commands.values(), force=options.force)
        _write(path, found, origin, record, force=options.force)
    except RiotError:
        if record is not None:  # else a second attempt would be refused because of it
            record.unlink(missing_ok=True)
        raise
    if options.start:
        found = _started(options, seen, found)
        _write(path, found, f"{origin}, and what its components did when riot started them", record, force=True)
    shown = redacted(options.endpoint)
    return {"file": str(path), "endpoint": shown, "started": options.start, **draft_json(found)}


def init_log(options: InitOptions, log: Path) -> dict[str, Any]:
    """Write a system file from a recording; result and errors as of `init_network`."""
    from riot_bus.draft.recording import look_at_log

    check_path(options.out, force=options.force)
    found = graph_draft(look_at_log(log), unit=options.unit, external=options.external)
    _write(options.out, found, f"what {log.name} shows", log, force=options.force)
    return {"file": str(options.out), "log": str(log), "started": False, **draft_json(found)}


def check_path(path: Path, *, force: bool) -> None:
    """Raise ConfigError if the system file exists, unless `force`."""
    if path.exists() and not force:
        raise ConfigError(
            "there is a system file already", where=str(path), hint="name another with -o, or use --force"
        )


def write_system(path: Path, text: str, *, force: bool) -> None:
    """Write the text of a valid system file.

    Raises:
        ConfigError: The file exists already, and `force` is not given, or it cannot be written.
    """
    SystemFile.model_validate({**tomllib.loads(text), "path": path.resolve()})
    check_path(path, force=force)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the system file: {error.strerror}", where=str(path)) from error


def _write(path: Path, found: SystemDraft, origin: str, nominal: Path | None, *, force: bool) -> None:
    log = None if nominal is None else _relative(nominal, path)
    text = draft_toml(found, origin=origin, name=path.resolve().parent.name or "system", nominal=log)
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


def _started(options: InitOptions, seen: Seen, found: SystemDraft) -> SystemDraft:
    """Return the draft with what components do when they are started."""
    from riot_bus.draft.first_run import first_run, with_run
    from riot_bus.trial.context import open_system

    startable = [part.name for part in found.parts if part.command.can_start]
    if not startable:
        raise ConfigError(
            "no component can be started, since no command is known completely",
            where=str(options.out),
            hint="fill in the commands, with {endpoint} in each",
        )
    run = first_run(open_system(options.out), startable, keys=seen.topics, seconds=options.seconds)
    return graph_draft(
        with_run(seen, run, found.names), unit=options.unit, external=options.external, names=found.names
    )
