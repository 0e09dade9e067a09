"""Dictionaries: exceptional values per type or field, and mutations per message, each with why it is worth trying.

They are TOML files (docs/dictionaries.md): those that the entry points `riot_bus.dictionaries` or riot.toml name.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from riot_bus.given_files import MOST_TOML, given_text
from riot_bus.inject.dictionary_file import RawEntry, binds, check_type, eligible, plain_value, read_file
from riot_bus.inject.mutations import Mutation, read_mutations
from riot_bus.plugins import DICTIONARIES
from riot_bus.types.capabilities import SuggestedValue
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.message import Scalar

_INDEX = re.compile(r"\[\d+\]")


@dataclass(frozen=True, slots=True)
class _Binding:
    pattern: str
    type: str | None
    entries: tuple[SuggestedValue, ...]
    only: bool
    where: str
    own: bool


class Dictionary:
    """Exceptional values by type and by field.

    Bindings of later files come before those of earlier ones; `values_for` returns no value twice.
    """

    def __init__(self) -> None:
        self._entries: list[tuple[str | None, SuggestedValue]] = []
        self._bindings: list[_Binding] = []
        self._mutations: dict[str, list[Mutation]] = {}

    def add(self, text: str, *, where: str, own: bool = False) -> None:
        """Add the text of a dictionary file.

        Raises:
            ConfigError: Not TOML, an unknown key or type, or a value that the type cannot hold.
        """
        document = read_file(text, where=where)
        check_type(document.type, f"{where}: type")
        for index, raw in enumerate(document.entry):
            place = f"{where}: entry[{index}]"
            kind = raw.type or document.type
            self._entries.append((kind, _checked(raw, kind, place)))
        for index, binding in enumerate(document.field):
            place = f"{where}: field[{index}]"
            kind = binding.type or document.type
            check_type(kind, f"{place}.type")
            entries = tuple(_checked(each, each.type or kind, place) for each in binding.entries)
            for pattern in reversed(binding.patterns):
                if not entries:
                    hint = "add entries = [{ value = ... }]"
                    raise ConfigError(f"no entries for {pattern!r}", where=place, hint=hint)
                if pattern.rpartition(":")[2].startswith("len("):
                    hint = 'set it by a mutation: [[message]] with mutations = [{ set = { "len(...)" = ... }, ... }]'
                    raise ConfigError(f"{pattern!r} is a length, which no value is bound to", where=place, hint=hint)
                self._bindings.insert(0, _Binding(pattern, kind, entries, binding.only, place, own))
        for index, message in enumerate(document.message):
            for mutation in read_mutations(message, where=f"{where}: message[{index}]", own=own):
                self._mutations.setdefault(mutation.type, []).append(mutation)

    def mutations_for(self, type_name: str) -> tuple[Mutation, ...]:
        """Return the mutations of a message type, such as `sensor_msgs/msg/Image`, without those of nested messages."""
        return tuple(self._mutations.get(type_name, ()))

    def mutated_types(self) -> tuple[str, ...]:
        """Return the message types that there are mutations for, sorted."""
        return tuple(sorted(self._mutations))

    def values_for(
        self, type: str, path: str | None = None, *, told: Iterable[SuggestedValue] = ()
    ) -> tuple[SuggestedValue, ...]:
        """Return the values worth trying in a field, those bound to its path first.

        The path may be `topic:path`. Values `told` by the field's definition are unused if a binding says `only`.

        Raises:
            ConfigError: The type is unknown, or a binding of the user's own for this path holds no value that the type
                can hold.
        """
        check_type(type, None)
        found: dict[object, SuggestedValue] = {}
        only = False
        for binding in self._bindings if path is not None else ():
            if not binds(binding.pattern, path or ""):
                continue
            fitting = [entry for entry in binding.entries if eligible(type, entry.value)]
            if binding.type not in (None, type) or not fitting:
                if not binding.own:
                    continue
                raise ConfigError(
                    f"none of the values for {binding.pattern!r} fits {path}, which is a {type}",
                    where=binding.where,
                    hint=f"give values of type {type}, or a narrower path",
                )
            for entry in fitting:
                found.setdefault(_identity(type, entry.value), entry)
            only = only or binding.only
        if not only:
            for entry in told:
                if eligible(type, entry.value):
                    found.setdefault(_identity(type, entry.value), entry)
            for kind, entry in self._entries:
                if kind == type or (kind is None and eligible(type, entry.value)):
                    found.setdefault(_identity(type, entry.value), entry)
        return tuple(found.values())

    def own(self) -> Dictionary:
        """Return the part that comes from the user's own files, without values for whole types."""
        found = Dictionary()
        found._bindings = [each for each in self._bindings if each.own]
        mine = {name: [each for each in some if each.own] for name, some in self._mutations.items()}
        found._mutations = {name: some for name, some in mine.items() if some}
        return found

    def unmatched(self, paths: Iterable[str]) -> Iterator[ConfigError]:
        """Yield an error for each `[[field]]` whose pattern matches none of these fields.

        A field's path is `topic:path`; for an array, some of its elements suffice.
        """
        known = list(paths)
        for binding in reversed(self._bindings):
            if not any(binds(_INDEX.sub("[*]", binding.pattern), path) for path in known):
                names = [path.rpartition(":")[2] for path in known]
                hint = did_you_mean(binding.pattern, [*known, *names])
                yield ConfigError(f"no field of the log is called {binding.pattern!r}", where=binding.where, hint=hint)


def installed_files() -> Iterator[tuple[str, str]]:
    """Yield names (`package/file.toml`) and texts of the dictionary files of all installed packages.

    Raises:
        ConfigError: A package cannot be loaded.
    """
    for name, module in DICTIONARIES.targets().items():
        try:
            folder = resources.files(DICTIONARIES.load(name))
        except ConfigError:
            raise
        except Exception as error:
            where = f"entry point {DICTIONARIES.group}: {name} = {module}"
            raise ConfigError(f"this dictionary does not load: {error!r}", where=where) from error
        for file in sorted(folder.iterdir(), key=lambda each: each.name):
            if file.name.endswith(".toml"):
                yield f"{module}/{file.name}", file.read_text(encoding="utf-8")


def own_text(path: Path) -> str:
    """Return the text of one of the user's own dictionary files; raises ConfigError if it cannot be read."""
    try:
        return given_text(path, most=MOST_TOML)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the dictionary: {error}", where=str(path)) from error


def load_dictionary(files: Sequence[Path] = ()) -> Dictionary:
    """Return the dictionary of all installed packages (entry points) and of the user's files.

    Raises:
        ConfigError: A file is missing or wrong.
    """
    dictionary = Dictionary()
    for where, text in installed_files():
        dictionary.add(text, where=where)
    for path in files:
        dictionary.add(own_text(path), where=str(path), own=True)
    return dictionary


def _checked(raw: RawEntry, kind: str | None, where: str) -> SuggestedValue:
    check_type(kind, where)
    value = plain_value(raw.value)
    if kind is not None and not eligible(kind, value):
        shown = value if len(repr(value)) <= 60 else f"{repr(value)[:57]}..."
        raise ConfigError(f"a {kind} cannot hold {shown!r}", where=where, hint=f"give a value of type {kind}")
    return SuggestedValue(value, raw.reason)


def _identity(kind: str, value: Scalar) -> object:
    if kind in ("float32", "float64"):
        return struct.pack("<d", value)
    return value
