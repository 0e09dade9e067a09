"""System files and findings: whose commands the steps start, and what is read of the file that a finding names."""

from __future__ import annotations

import logging
import os
import shlex
import sysconfig
from pathlib import Path

from riot_bus.findings.records import FindingRecord, shortest_log
from riot_bus.log.foreign import learn_types
from riot_bus.log.reader import LogReader
from riot_bus.system.system_file import SystemFile, read_system
from riot_bus.trial.context import types_of
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, RiotError

_LOG = logging.getLogger(__name__)
_MOST_COMMANDS = 8  # a few lines of a terminal; the file has all of them
_NAME = "riot.toml"


def system_of(recorded: str | None, folder: Path, *, named: Path | None = None, root: Path = Path()) -> Path:
    """Return the system file whose commands are started: the named one, else `riot.toml` in the folder of the project.

    Others may have written the finding, the file that it names, and what that starts. So this file is taken only if it
    is the same project's: below `root`, in another of its folders than the finding. Riot's own examples are taken too.

    Raises:
        ConfigError: There is none; the error names what the recorded file would start.
    """
    here, own = root / _NAME, Path(recorded or root / _NAME)
    if named is not None:
        return named
    if here.is_file():
        if not own.exists() or not own.samefile(here):
            _LOG.warning("riot: this was found with %s; taking %s", own, here.absolute())
        return here
    if not own.is_file():
        nor = f", and no {own}" if recorded else ""
        raise ConfigError(f"there is no {_NAME} in {root.absolute()}{nor}", hint="name yours with --system FILE")
    if any(own.resolve().is_relative_to(place) for place in _example_places()):
        return own
    if _same_project(own, folder, root):
        _LOG.warning("riot: starting what %s describes, with which this was found", own)
        return own
    commands = ", ".join(_commands(own)) or "unknown commands"
    raise ConfigError(
        f"{folder} names {own}, which is not this project's and would start: {commands}",
        where=str(root.absolute()),
        hint=f"to start these, add --system {shlex.quote(str(own))} (in pytest: RIOT_SYSTEM); else work where your "
        f"own {_NAME} is",
    )


def _same_project(own: Path, folder: Path, root: Path) -> bool:
    """Return whether a file lies below `root`, and the finding not beside it: in what one may have unpacked there."""
    below = os.path.relpath(own.resolve(), root.resolve())
    return not below.startswith("..") and not folder.resolve().is_relative_to(root.resolve() / Path(below).parts[0])


def _commands(path: Path) -> list[str]:
    """Return what a system file would start, each in a few words; empty if it cannot be read."""
    try:
        file = read_system(path)
    except RiotError:
        return []
    found = [f"{name} (a monitor)" for name in file.monitor_files]
    clock = file.system.clock
    resets = [file.system.reset, clock.reset if clock is not None else None]
    found += [f"`{shlex.join(one.command)}` (a reset)" for one in resets if one is not None and one.command]
    for name, one in zip([*file.components, *file.unit], file.programs, strict=True):
        ways = {"setup": one.setup, "command": one.command, "ready": one.ready.command}
        ways |= {"stop": one.stop_command, "teardown": one.teardown}
        found += [f"`{shlex.join(words)}` ({way} of {name})" for way, words in ways.items() if words]
        if one.container is not None:
            found.append(f"`{one.container.engine or 'docker'}` with {one.container.image} ({name})")
    found = list(dict.fromkeys(found))
    return [*found[:_MOST_COMMANDS], *([f"and {len(found) - _MOST_COMMANDS} more"] if found[_MOST_COMMANDS:] else [])]


def described(folder: Path, *, named: Path | None = None) -> tuple[SystemFile | None, TypeRegistry]:
    """Return the system file of a finding, to be read alone, and the types of its messages, also those in its log.

    Of what the file names, installed adapters and codecs are loaded, and nothing else. It is None if it cannot be read.

    Raises:
        ConfigError: The named file cannot be used.
    """
    path, file, registry = named or Path(FindingRecord.load(folder).system_file), None, None
    try:
        if named is not None or path.is_file():
            registry = types_of(file := read_system(path))
    except RiotError as error:
        if named is not None:
            raise
        _LOG.warning("riot: types are those in the finding's log, as its system file cannot be used: %s", error)
    registry = registry or TypeRegistry(load_adapters())
    log = shortest_log(folder)
    if log.is_file():
        with LogReader(log) as reader:
            learn_types(reader, registry)
    return file, registry


def _example_places() -> list[Path]:
    """Return the folders that riot's own examples may be in: beside this package, or where the wheel put them."""
    wheel = Path(sysconfig.get_path("data")) / "share" / "riot_bus" / "examples"
    return [Path(__file__).resolve().parents[2] / "examples", wheel.resolve()]


def find_example(name: str) -> Path:
    """Return the riot.toml of an example.

    Raises:
        ConfigError: It is in neither place.
    """
    places = _example_places()
    for place in places:
        if (place / name / "riot.toml").is_file():
            return place / name / "riot.toml"
    raise ConfigError(f"the example {name!r} is not installed", hint=f"looked in {', '.join(map(str, places))}")
