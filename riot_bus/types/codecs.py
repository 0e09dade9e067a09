"""Codecs by name, found by the entry points `riot_bus.types`; each is loaded when it is first named."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from riot_bus.plugins import CODECS
from riot_bus.types.model import MessageType, TypeSource
from riot_bus.types.raw_type import OpaqueType
from riot_bus.vocabulary.errors import ConfigError, RiotError

Codec = MessageType | TypeSource
"""Instance of a codec's class: the one type of a self-describing encoding, or a source of types."""

_DEFINITIONS = {".binpb": "protobuf", ".desc": "protobuf"}
_PREFIXES = ("application/", "text/", "vnd.", "x-", "google.")


class Codecs:
    """The codecs of one registry."""

    def __init__(self) -> None:
        self._loaded: dict[str, Codec] = {}

    @cached_property
    def _targets(self) -> dict[str, str]:
        return CODECS.targets()  # takes 1 ms, and a log may have 60,000 channels

    def names(self) -> list[str]:
        """Return the names of all codecs that are shipped or installed."""
        return list(CODECS.targets())

    def loaded(self) -> list[Codec]:
        """Return the codecs loaded so far."""
        return list(self._loaded.values())

    def load(self, name: str) -> Codec:
        """Return a codec.

        Raises:
            ConfigError: There is none of this name, or it cannot be loaded.
            MissingExtraError: Its optional dependency is not installed.
        """
        found = self._loaded.get(name)
        if found is None:
            found = self._loaded[name] = _made(name)
        return found

    def of_encoding(self, encoding: str) -> Codec | None:
        """Return the codec of an encoding, None if there is none.

        The codec `cbor` serves `cbor`, `application/cbor`, `application/x-cbor` and similar encodings. A codec that
        cannot be loaded is replaced by an opaque type that says why.
        """
        name = encoding.lower()
        for prefix in _PREFIXES:
            name = name.removeprefix(prefix)
        if name not in self._targets:
            return None
        try:
            return self.load(name)
        except RiotError as error:
            reason = f"{error.message} ({error.hint})" if error.hint else error.message
            self._loaded[name] = OpaqueType(name, name, reason)
            return self._loaded[name]

    def of_type(self, type_name: str) -> Codec | None:
        """Return the codec whose name begins the name of a type, such as `cbor` or `raw(...)`; None if there is none.

        Raises:
            ConfigError: It cannot be loaded.
        """
        name = type_name.partition("(")[0]
        return self.load(name) if name in self._loaded or (name.isidentifier() and name in self._targets) else None

    def of_file(self, file: Path) -> TypeSource | None:
        """Return the codec whose types a file defines, by the file's ending; None if the file is for an adapter.

        Raises:
            ConfigError: It cannot be loaded.
        """
        name = _DEFINITIONS.get(file.suffix, file.suffix.removeprefix("."))
        if name not in CODECS.targets():
            return None
        found = self.load(name)
        return found if isinstance(found, TypeSource) else None


def _made(name: str) -> Codec:
    kind, where = CODECS.load(name), CODECS.targets()[name]
    try:
        made = kind()
    except RiotError:
        raise
    except Exception as error:  # a third-party package may raise anything
        hint = "fix or uninstall the package"
        raise ConfigError(f"codec {name!r} cannot be loaded: {error}", where=where, hint=hint) from error
    if not isinstance(made, MessageType | TypeSource):
        hint = "its class has to implement one of these protocols of riot_bus.types.model"
        raise ConfigError(f"codec {name!r} is neither a MessageType nor a TypeSource", where=where, hint=hint)
    return made
