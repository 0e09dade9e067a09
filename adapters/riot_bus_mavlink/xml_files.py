"""Reader of dialects, the XML files that define messages and enums of MAVLink."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus_mavlink.definitions import (
    SIZES,
    DialectError,
    EnumEntry,
    EnumTable,
    FieldText,
    MessageTable,
    Param,
    make_message,
)

if TYPE_CHECKING:
    from collections.abc import Iterable
    from xml.etree.ElementTree import Element

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,127}")
_TYPE = re.compile(r"([a-z0-9_]+)(?:\[([0-9]{1,3})\])?")
_POWER = re.compile(r"([0-9]{1,2})\*\*([0-9]{1,2})")
_ALIASES = {"uint8_t_mavlink_version": "uint8_t", "array": "int8_t"}
_MOST_BYTES = 1 << 24  # 27 times pymavlink's largest file; the tree of elements takes even more memory


@dataclass(slots=True)
class DialectFile:
    """Definitions in one file, and the names of the files that it includes."""

    includes: list[str] = field(default_factory=list)
    messages: list[MessageTable] = field(default_factory=list)
    enums: list[EnumTable] = field(default_factory=list)


class _Builder(ElementTree.TreeBuilder):
    """Builds a tree from XML without a document type, so that there are no entities that expand."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        del name, pubid, system
        raise DialectError("a document type is not allowed in a dialect")


def parse_dialect(data: bytes, *, where: str) -> DialectFile:
    """Read the XML of a dialect, without the files that it includes.

    Raises:
        ConfigError: The file is not XML, or defines something impossible.
    """
    if len(data) > _MOST_BYTES:
        raise ConfigError(f"{len(data)} bytes are too many for a dialect", where=where)
    try:
        parser = ElementTree.XMLParser(target=_Builder())  # noqa: S314 - entities need a document type
        parser.feed(data)
        root: Element = parser.close()
        if root.tag != "mavlink":
            raise DialectError(f"the root element is <{root.tag}> instead of <mavlink>")
        found = DialectFile([(each.text or "").strip() for each in root.iterfind("include")])
        for each in root.iterfind("enums/enum"):
            found.enums.append(_enum(each))
        for each in root.iterfind("messages/message"):
            found.messages.append(_message(each))
    except (ElementTree.ParseError, DialectError, LookupError, ValueError) as error:  # no such encoding
        raise ConfigError(f"not a dialect of MAVLink: {error}", where=where) from error
    return found


def _message(element: Element) -> MessageTable:
    name = _name(element)
    number = _integer(element.get("id", ""), f"the id of message {name}")
    if not 0 <= number < 1 << 24:  # MAVLink 2 has 24 bits for it
        raise DialectError(f"message {name}: {number} is not an id")
    fields = []
    extension = False
    for each in element:
        extension = extension or each.tag == "extensions"
        if each.tag == "field":
            fields.append(_field(each, name, extension=extension))
    try:
        return make_message(number, name, fields)
    except DialectError as error:
        raise DialectError(f"message {name}: {error}") from None


def _field(element: Element, message: str, *, extension: bool) -> FieldText:
    name = _name(element)
    text = element.get("type", "")
    match = _TYPE.fullmatch(text)
    kind, array = (match[1], int(match[2] or 0)) if match is not None else ("", 0)
    kind = _ALIASES.get(kind, kind)
    if kind not in SIZES:
        kind = f"{kind}_t"
    if kind not in SIZES or array > 255 or (match is not None and match[2] is not None and not array):
        raise DialectError(f"message {message}: {name} has type {text!r}; {did_you_mean(text, SIZES)}")
    return FieldText(
        name, kind, array, extension,
        unit=element.get("units", ""),
        enum=element.get("enum", ""),
        bitmask=element.get("display") == "bitmask",
        invalid=element.get("invalid", ""),
        low=_number(element, "minValue"),
        high=_number(element, "maxValue"),
    )  # fmt: skip


def _enum(element: Element) -> EnumTable:
    table = EnumTable(_name(element), element.get("bitmask") == "true")
    following = 0
    for each in element.iterfind("entry"):
        text = each.get("value")
        value = following if text is None else _integer(text, f"{each.get('name')} of {table.name}")
        table.entries[value] = EnumEntry(_name(each), value, tuple(_params(each.iterfind("param"))))
        following = value + 1
    return table


def _params(elements: Iterable[Element]) -> Iterable[Param]:
    for each in elements:
        yield Param(
            _integer(each.get("index", ""), "the index of a parameter"),
            label=each.get("label", ""),
            unit=each.get("units", ""),
            enum=each.get("enum", ""),
            low=_number(each, "minValue"),
            high=_number(each, "maxValue"),
            increment=_number(each, "increment"),
            reserved=each.get("reserved") == "true",
        )


def _name(element: Element) -> str:
    name = element.get("name", "")
    if not _NAME.fullmatch(name):
        raise DialectError(f"<{element.tag}> has the name {name!r}")
    return name


def _integer(text: str, what: str) -> int:
    power = _POWER.fullmatch(text.strip())
    try:
        if len(text) > 40:
            raise ValueError
        return int(power[1]) ** int(power[2]) if power is not None else int(text, 0)
    except ValueError:
        raise DialectError(f"{what} is {text[:40]!r}, which is not an integer") from None


def _number(element: Element, name: str) -> float | None:
    text = element.get(name)
    try:
        return None if text is None else float(text)
    except ValueError:
        raise DialectError(f"{name}={text!r} of {element.get('name')!r} is not a number") from None
