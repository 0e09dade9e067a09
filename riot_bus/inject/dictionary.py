"""Dictionaries: exceptional values per type or field, and mutations per message, each with why it is worth trying.

A dictionary is a TOML file:

    type = "float64"                       # optional: the type of every entry that names none

    [[entry]]
    value = nan                            # or {hex = "00ff"} for bytes, {repeat = "A", times = 4096} for long text
    reason = "not a number"

    [[field]]                              # values for some fields only, by a path pattern (`*` = anything)
    path = "*.linear.x"
    type = "float64"                       # optional: then every value is checked when the file is read
    only = true                            # optional: nothing but these values for such fields
    entries = [{ value = 1e6, reason = "faster than any robot" }]

    [[message]]                            # fields that are changed together, by message type: see `mutations`

Files come from the packages that the entry point group `riot_bus.dictionaries` names, and from riot.toml.
"""

from __future__ import annotations

import re
import struct
import tomllib
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib import resources
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from riot_bus.inject.mutations import Mutation, RawMessage, RawMutation, read_mutations
from riot_bus.plugins import DICTIONARIES
from riot_bus.types.capabilities import SuggestedValue
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from riot_bus.vocabulary.trial import Scalar

__all__ = ["TYPES", "Dictionary", "SuggestedValue", "eligible", "load_dictionary"]

_INTEGERS = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
TYPES = ("bool", *_INTEGERS, "float32", "float64", "string", "bytes")
"""The primitive types of fields."""

_INDEX = re.compile(r"\[\d+\]")
_STRICT = ConfigDict(extra="forbid", strict=True)


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

    Bindings of later files come before those of earlier ones; `values_for` names no value twice.
    """

    def __init__(self) -> None:
        self._entries: list[tuple[str | None, SuggestedValue]] = []
        self._bindings: list[_Binding] = []
        self._mutations: dict[str, list[Mutation]] = {}

    def add(self, text: str, *, where: str, own: bool = False) -> None:
        """Take in the text of a dictionary file.

        Args:
            text: TOML.
            where: Names it in errors.
            own: Whether it is the user's own, so that fields that do not exist are said.

        Raises:
            ConfigError: Not TOML, an unknown key or type, or a value that the type cannot hold.
        """
        try:
            document = _File.model_validate(tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"not a TOML file: {error}", where=where) from error
        except ValidationError as error:
            raise _explain(error, where) from None
        _check_type(document.type, f"{where}: type")
        for index, raw in enumerate(document.entry):
            place = f"{where}: entry[{index}]"
            kind = raw.type or document.type
            self._entries.append((kind, raw.checked(kind, place)))
        for index, binding in enumerate(document.field):
            place = f"{where}: field[{index}]"
            kind = binding.type or document.type
            _check_type(kind, f"{place}.type")
            entries = tuple(each.checked(each.type or kind, place) for each in binding.entries)
            if not entries:
                raise ConfigError(
                    f"no entries for {binding.path!r}", where=place, hint="add entries = [{ value = ... }]"
                )
            self._bindings.insert(0, _Binding(binding.path, kind, entries, binding.only, place, own))
        for index, message in enumerate(document.message):
            for mutation in read_mutations(message, where=f"{where}: message[{index}]", own=own):
                self._mutations.setdefault(mutation.type, []).append(mutation)

    def mutations_for(self, type_name: str) -> tuple[Mutation, ...]:
        """Return the mutations of messages of a type, such as `sensor_msgs/msg/Image`; not those of messages in it."""
        return tuple(self._mutations.get(type_name, ()))

    def mutated_types(self) -> tuple[str, ...]:
        """Return the message types that there are mutations for, sorted."""
        return tuple(sorted(self._mutations))

    def values_for(
        self, type: str, path: str | None = None, *, told: Iterable[SuggestedValue] = ()
    ) -> tuple[SuggestedValue, ...]:
        """Return the values worth trying in a field, those bound to its path first.

        Args:
            type: Primitive type of the field.
            path: Field path (or `topic:path`) to look bindings up by.
            told: What the field's definition tells (`riot_bus.types.capabilities`), not where a binding says `only`.

        Raises:
            ConfigError: The type is unknown, or a binding for this path holds no value that the type can hold.
        """
        _check_type(type, None)
        found: dict[object, SuggestedValue] = {}
        only = False
        for binding in self._bindings if path is not None else ():
            if not _bound(binding.pattern, path or ""):
                continue
            fitting = [entry for entry in binding.entries if eligible(type, entry.value)]
            if binding.type not in (None, type) or not fitting:
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

    def unmatched(self, paths: Iterable[str]) -> Iterator[ConfigError]:
        """Yield what to say of each `[[field]]` of the user's own that none of these fields has values from.

        Args:
            paths: All fields (`topic:path`); of an array some elements will do.
        """
        known = list(paths)
        for binding in reversed(self._bindings):
            if binding.own and not any(_bound(_INDEX.sub("[*]", binding.pattern), path) for path in known):
                names = [path.rpartition(":")[2] for path in known]
                hint = did_you_mean(binding.pattern, [*known, *names])
                yield ConfigError(f"no field of the log is called {binding.pattern!r}", where=binding.where, hint=hint)


def load_dictionary(files: Sequence[Path] = ()) -> Dictionary:
    """Return the dictionary of all installed packages (entry points) and of the user's files.

    Raises:
        ConfigError: A file is missing or wrong.
    """
    dictionary = Dictionary()
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
                dictionary.add(file.read_text(encoding="utf-8"), where=f"{module}/{file.name}")
    for path in files:
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"cannot read the dictionary: {error}", where=str(path)) from error
        dictionary.add(text, where=str(path), own=True)
    return dictionary


def eligible(type: str, value: Scalar) -> bool:
    """Return whether a field of this type can hold the value."""
    if type in _INTEGERS:
        low, high = _INTEGERS[type]
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
    if type == "bool":
        return isinstance(value, bool)
    if type in ("float32", "float64"):
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        try:
            struct.pack("<f" if type == "float32" else "<d", value)
        except (OverflowError, struct.error):
            return False
        return True
    return isinstance(value, bytes if type == "bytes" else str)


class _Hex(BaseModel):
    model_config = _STRICT
    hex: Annotated[str, Field(pattern=r"^([0-9a-fA-F]{2})*$")]


class _Repeat(BaseModel):
    model_config = _STRICT
    repeat: str | _Hex
    times: Annotated[int, Field(ge=1, le=2**24)]


class _RawEntry(BaseModel):
    model_config = _STRICT
    value: bool | int | float | str | _Hex | _Repeat
    reason: Annotated[str, Field(min_length=1)]
    type: str | None = None

    def checked(self, kind: str | None, where: str) -> SuggestedValue:
        _check_type(kind, where)
        value = _plain(self.value)
        if kind is not None and not eligible(kind, value):
            shown = value if len(repr(value)) <= 60 else f"{repr(value)[:57]}..."
            raise ConfigError(f"a {kind} cannot hold {shown!r}", where=where, hint=f"give a value of type {kind}")
        return SuggestedValue(value, self.reason)


class _RawField(BaseModel):
    model_config = _STRICT
    path: Annotated[str, Field(min_length=1)]
    entries: list[_RawEntry]
    type: str | None = None
    only: bool = False


class _File(BaseModel):
    model_config = _STRICT
    type: str | None = None
    entry: list[_RawEntry] = []
    field: list[_RawField] = []
    message: list[RawMessage] = []


def _plain(value: Any) -> Scalar:
    if isinstance(value, _Repeat):
        return _plain(value.repeat) * value.times
    return bytes.fromhex(value.hex) if isinstance(value, _Hex) else value


def _check_type(kind: str | None, where: str | None) -> None:
    if kind is not None and kind not in TYPES:
        raise ConfigError(f"unknown type {kind!r}", where=where, hint=did_you_mean(kind, TYPES))


def _bound(pattern: str, path: str) -> bool:
    literal = pattern.replace("[", "[[]")  # brackets are indices here, not character sets
    return fnmatchcase(path, literal) or fnmatchcase(path.rpartition(":")[2], literal)


def _identity(kind: str, value: Scalar) -> object:
    if kind in ("float32", "float64"):
        return struct.pack("<d", value)
    return value


def _explain(error: ValidationError, where: str) -> ConfigError:
    problems = error.errors()
    first = next((each for each in problems if each["type"] == "extra_forbidden"), problems[0])
    tags = ("bool", "int", "float", "str", "_Hex", "_Repeat")
    place: list[str | int] = [part for part in first["loc"] if part not in tags]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")
    if first["type"] != "extra_forbidden":
        return ConfigError(first["msg"], where=f"{where}: {key}")
    word = str(place[-1])
    model: type[BaseModel] = _File if len(place) == 1 else _RawEntry
    if place[0] == "message":
        model = RawMutation if len(place) > 3 else RawMessage
    elif place[0] == "field" and len(place) == 3:
        model = _RawField
    known = model.model_fields
    return ConfigError(f"unknown key {word!r}", where=f"{where}: {key}", hint=did_you_mean(word, known))
