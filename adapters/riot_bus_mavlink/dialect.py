"""Dialects: messages and enums, from those that pymavlink ships and from the user's own files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

from riot_bus.given_files import given_bytes
from riot_bus.vocabulary.errors import ConfigError, did_you_mean, require_package
from riot_bus_mavlink.definitions import EnumTable, MessageTable
from riot_bus_mavlink.xml_files import DialectFile, parse_dialect

DEFAULT = "all"
"""The dialect that contains all others that pymavlink ships."""

_UNKNOWN = "UNKNOWN_"
_MOST_FILES = 256  # pymavlink ships 19; includes are nested calls, of which Python allows 1000


class Dialect:
    """The messages that are known.

    Args:
        parts: Contents of its files; later ones replace messages with the same id or name, and add to enums.
    """

    def __init__(self, name: str, parts: Iterable[DialectFile]) -> None:
        self.name = name
        self.messages: dict[int, MessageTable] = {}
        self._ids: dict[str, int] = {}
        self.enums: dict[str, EnumTable] = {}
        for part in parts:
            for message in part.messages:
                self._add(message)
            for enum in part.enums:
                known = self.enums.setdefault(enum.name, EnumTable(enum.name))
                known.bitmask = known.bitmask or enum.bitmask
                known.entries.update(enum.entries)
        self._extras = {number: message.crc_extra for number, message in self.messages.items()}
        self._targets = {number: message.targets for number, message in self.messages.items()}

    def crc_extra(self, message_id: int) -> int | None:
        """Return a message's CRC extra byte, None if the message is unknown."""
        return self._extras.get(message_id)

    def name_of(self, message_id: int) -> str:
        """Return the name of a message: `UNKNOWN_1234` if it is not known."""
        message = self.messages.get(message_id)
        return f"{_UNKNOWN}{message_id}" if message is None else message.name

    def id_of(self, name: str) -> int | None:
        """Return the id of a message, also of `UNKNOWN_1234`; None if there is no such name."""
        number = self._ids.get(name)
        if number is None and name.startswith(_UNKNOWN):
            text = name.removeprefix(_UNKNOWN)
            number = int(text) if text.isdecimal() and text.isascii() and len(text) <= 8 else None
        return number

    def message(self, name: str) -> MessageTable | None:
        """Return the definition of a message, None if it is not known."""
        number = self._ids.get(name)
        return None if number is None else self.messages[number]

    def targets(self, message_id: int) -> tuple[int | None, int | None]:
        """Return the payload offsets of target system and target component, None where there is none.

        Bytes beyond the end of a payload are zeros that were cut off.
        """
        return self._targets.get(message_id, (None, None))

    def _add(self, message: MessageTable) -> None:
        before = self.messages.pop(message.id, None)
        if before is not None:
            del self._ids[before.name]
        other = self._ids.pop(message.name, None)
        if other is not None:
            del self.messages[other]
        self.messages[message.id] = message
        self._ids[message.name] = message.id


def dialect_names() -> list[str]:
    """Return the names of the dialects that pymavlink ships."""
    return sorted(file.stem for file in _shipped_folder().glob("*.xml"))


def load_dialect(name: str = DEFAULT, files: Sequence[Path] = ()) -> Dialect:
    """Load a dialect that pymavlink ships, and the user's files.

    Args:
        name: Such as `all` or `ardupilotmega`; empty for none.
        files: XML files. What they include is looked for beside them, then among pymavlink's.

    Raises:
        ConfigError: There is no such dialect, or a file is missing or wrong.
        MissingExtraError: pymavlink or fastcrc is not installed.
    """
    return _load(name, tuple(map(Path, files))) if files else _shipped(name)


def _load(name: str, files: Sequence[Path] = ()) -> Dialect:
    parts: dict[Path, DialectFile] = {}
    for file in (*([_shipped_file(name)] if name else ()), *files):
        _read(file, parts)
    return Dialect(name, parts.values())


_shipped = lru_cache(maxsize=4)(_load)


def _shipped_folder() -> Path:
    spec = require_package("pymavlink", "mavlink")
    return Path(next(iter(spec.submodule_search_locations or ()))) / "dialects" / "v20"


def _shipped_file(name: str) -> Path:
    known = dialect_names()
    if name not in known:
        raise ConfigError(f"unknown dialect {name!r} of MAVLink", hint=did_you_mean(name, known))
    return _shipped_folder() / f"{name}.xml"


def _read(file: Path, parts: dict[Path, DialectFile]) -> None:
    """Read a file and those that it includes, each once, into `parts`; a file comes after its includes."""
    place = file.resolve()
    if place in parts:
        return
    if len(parts) >= _MOST_FILES:
        raise ConfigError(f"more than {_MOST_FILES} files are included", where=str(file))
    try:
        data = given_bytes(place)
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror}", where=str(file)) from error
    found = parse_dialect(data, where=str(file))
    parts[place] = DialectFile()  # placeholder, so that circular includes end
    for include in found.includes:
        beside = file.parent / include
        _read(beside if beside.is_file() else _shipped_folder() / Path(include).name, parts)
    del parts[place]
    parts[place] = found
