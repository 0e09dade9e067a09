"""Views of dictionary files: which there are, their contents, and the fields of a log to which these apply."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from riot_bus.campaign.bindings import AppliesTo, applied, misfits
from riot_bus.chain.base.logs import inputs_of, read_messages
from riot_bus.inject.dictionary import Dictionary, installed_files, own_text
from riot_bus.inject.dictionary_file import DictionaryFile, read_file
from riot_bus.system.system_file import read_system
from riot_bus.trial.context import types_of
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.message import Message


@dataclass(frozen=True, slots=True)
class ListedDictionary:
    """A dictionary file in a list."""

    name: str
    units: tuple[str, ...]
    values: int
    fields: int
    mutations: int


@dataclass(frozen=True, slots=True)
class DictionaryLog:
    """A log to which a dictionary is applied."""

    name: str
    messages: Sequence[Message]
    registry: TypeRegistry
    leave: Sequence[str] = ()
    include: Sequence[str] = ()


def list_dictionaries(system: Path | None) -> list[ListedDictionary]:
    """Return the dictionary files of all installed packages, and those that a system file names.

    Raises:
        ConfigError: The system file or a dictionary cannot be read.
    """
    found = [_counted(name, text, ()) for name, text in installed_files()]
    if system is not None:
        file = read_system(system)
        units: dict[Path, list[str]] = {}
        for unit, settings in file.unit.items():
            for name in settings.dictionaries:
                units.setdefault(file.root / name, []).append(unit)
        found += [_counted(str(path), own_text(path), tuple(names)) for path, names in units.items()]
    return found


def _counted(name: str, text: str, units: tuple[str, ...]) -> ListedDictionary:
    file = read_file(text, where=name)
    return ListedDictionary(
        name, units, len(file.entry), len(file.field), sum(len(each.mutations) for each in file.message)
    )


def find_dictionary(name: str) -> tuple[str, str]:
    """Return the name and the text of a dictionary file, given by its path or, if installed, by a name like `float64`.

    Raises:
        ConfigError: There is no such file, or more than one.
    """
    if Path(name).is_file():
        return name, own_text(Path(name))
    files = dict(installed_files())
    same = [each for each in files if name in (each, each.rpartition("/")[2], Path(each).stem)]
    if len(same) != 1:
        hint = f"name one of: {', '.join(same)}" if same else did_you_mean(name, {Path(each).stem for each in files})
        problem = (
            f"{len(same)} dictionaries are called {name!r}" if same else f"no dictionary {name!r}, nor such a file"
        )
        raise ConfigError(problem, hint=hint)
    return same[0], files[same[0]]


def log_to_apply_to(log: Path | None, system: Path | None, unit: str | None) -> DictionaryLog | None:
    """Return the log to use: a file, or the inputs of a unit in it or in the nominal log; None if none is named.

    Raises:
        ConfigError: A file cannot be read, or there is no nominal log yet.
    """
    if system is None:
        if unit is not None:
            raise ConfigError(f"--unit {unit!r} needs the system file that describes it", hint="add --system riot.toml")
        if log is None:
            return None
        registry = TypeRegistry(load_adapters())
        return DictionaryLog(str(log), read_messages(log, registry=registry), registry)
    file = read_system(system)
    registry = types_of(file)
    unit = file.choose_unit(unit)
    settings = file.unit[unit]
    named = settings.log or file.system.nominal
    path = log or (file.root / named if named else None)
    if path is None:
        hint = "name one by --log, such as the nominal.mcap in the output folder of `riot test`"
        raise ConfigError("the system file names no nominal log", where=str(system), hint=hint)
    messages = inputs_of(unit, read_messages(path, registry=registry), file=file, registry=registry, path=path)
    return DictionaryLog(f"inputs of {unit} in {path}", messages, registry, settings.leave, settings.include)


def tables_applied(name: str, text: str, where: DictionaryLog | None) -> tuple[DictionaryFile, dict[str, AppliesTo]]:
    """Return a dictionary file, and what its tables apply to in a log; nothing of that without a log.

    Raises:
        ConfigError: The file is wrong.
    """
    file = read_file(text, where=name)
    if where is None:
        return file, {}
    return file, applied(file, text, where.messages, where.registry, leave=where.leave, include=where.include)


def errors_of(path: Path, where: DictionaryLog | None) -> tuple[ListedDictionary | None, list[ConfigError]]:
    """Return the contents of a file of the user's own, if it can be read, and all of its errors."""
    try:
        text = own_text(path)
        if where is None:
            Dictionary().add(text, where=str(path), own=True)
            problems = []
        else:
            problems = misfits(text, str(path), where.messages, where.registry)
    except ConfigError as error:
        return None, [error]
    return _counted(str(path), text, ()), problems
