"""`riot init` of a plain Zenoh system: a first riot.toml from a router or a recording."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.sut.init import check_path, write_system
from riot_bus.sut.plain_draft import plain_draft
from riot_bus.sut.plain_look import look_at_log, look_at_network
from riot_bus.sut.plain_scaffold import draft_json, draft_toml
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.redaction import redacted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.sut.command_draft import CommandDraft
    from riot_bus.sut.plain_draft import PlainDraft, PlainFacts

__all__ = ["init_plain", "init_plain_log"]


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
        EnvironmentFaultError: Nobody answers, or nothing was seen.
    """
    from riot_bus.control.component import client_cfg

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
