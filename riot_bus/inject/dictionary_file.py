"""A dictionary file as it is written: its tables, the values that types can hold, and its JSON Schema."""

from __future__ import annotations

import functools
import struct
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from riot_bus.config.toml_file import explained_key
from riot_bus.inject.mutations import HexBytes, RawMessage, RawMutation
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.field_pattern import names_field
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.toml_text import parse_toml

_INTEGERS = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
TYPES = ("bool", *_INTEGERS, "float32", "float64", "string", "bytes")
"""The primitive types of fields."""

_STRICT = ConfigDict(extra="forbid", strict=True, use_attribute_docstrings=True)
_Pattern = Annotated[str, Field(min_length=1)]
_Type = Annotated[str, Field(json_schema_extra={"enum": list(TYPES)})]


class RepeatedText(BaseModel):
    """Long text or bytes: a piece that is repeated."""

    model_config = _STRICT
    repeat: str | HexBytes
    times: Annotated[int, Field(ge=1, le=2**24)]


class RawEntry(BaseModel):
    """One value that is worth trying."""

    model_config = _STRICT
    value: bool | int | float | str | HexBytes | RepeatedText
    reason: Annotated[str, Field(min_length=1)]
    """Why this is worth trying."""
    type: _Type | None = None
    """Type of the fields that it is for; by default that of what is around, or every one that can hold it."""


class RawField(BaseModel):
    """One `[[field]]`: values for some fields only."""

    model_config = _STRICT
    path: _Pattern | Annotated[list[_Pattern], Field(min_length=1)]
    """Pattern of the fields, or several: a path or `topic:path`; `*` stands for any text."""
    entries: list[RawEntry]
    type: _Type | None = None
    """Type of these fields; then every value is checked when the file is read."""
    only: bool = False
    """Whether nothing but these values is tried in such fields."""

    @property
    def patterns(self) -> tuple[str, ...]:
        """The patterns of the fields."""
        return (self.path,) if isinstance(self.path, str) else tuple(self.path)


class DictionaryFile(BaseModel):
    """A dictionary of riot_bus: exceptional values for fields, and mutations of messages."""

    model_config = _STRICT
    type: _Type | None = None
    """Type of every entry that names none."""
    entry: list[RawEntry] = []
    field: list[RawField] = []
    message: list[RawMessage] = []


@functools.lru_cache(64)
def read_file(text: str, *, where: str) -> DictionaryFile:
    """Read the text of a dictionary file; each step of a chain reads the same ones again.

    Raises:
        ConfigError: Not TOML, an unknown key, or a value of the wrong kind.
    """
    try:
        return DictionaryFile.model_validate(parse_toml(text, where=where))
    except ValidationError as error:
        tags = ("bool", "int", "float", "str", "HexBytes", "RepeatedText")
        raise explained_key(error, where, tags, _table_at) from None


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of dictionary files."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **DictionaryFile.model_json_schema()}


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


def plain_value(value: Any) -> Scalar:
    """Return a value as a field holds it: hexadecimal digits as bytes, and repeated text at its full length."""
    if isinstance(value, RepeatedText):
        return plain_value(value.repeat) * value.times
    return bytes.fromhex(value.hex) if isinstance(value, HexBytes) else value


def check_type(kind: str | None, where: str | None) -> None:
    """Raise ConfigError unless a type is one of `TYPES` or None."""
    if kind is not None and kind not in TYPES:
        raise ConfigError(f"unknown type {kind!r}", where=where, hint=did_you_mean(kind, TYPES))


def binds(pattern: str, path: str) -> bool:
    """Return whether a binding's pattern matches a field; the path may be `topic:path`."""
    return names_field(pattern, path) or names_field(pattern, path.rpartition(":")[2])


def _table_at(place: list[str | int]) -> type[BaseModel]:
    if place[0] == "message":
        return {1: DictionaryFile, 3: RawMessage}.get(len(place), RawMutation)
    if place[0] == "field" and len(place) == 3:
        return RawField
    return DictionaryFile if len(place) == 1 else RawEntry
