"""Texts with a structure, such as NMEA sentences or `key=value` lists: changed part by part, the check sum mended.

Delimiter and check sum are those that fit all nominal texts of a field.
"""

from __future__ import annotations

import json
import re
import zlib
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from itertools import pairwise
from operator import xor
from typing import NamedTuple

from riot_bus.types.capabilities import SuggestedValue
from riot_bus.types.json_type import JsonType
from riot_bus.types.model import parse_path

_SURE, _LIKELY = ",;|\t&", ":/ -"
"""Delimiters: of those in the second group, people's names and words have one, too, so that it takes two."""
_KINDS = 4  # of sentences, by their first part and their number of parts
_PARTS = 32  # of a text; each has about ten changes
_SUMMED = re.compile(r"(?s)([$!]?)(.*?)([*#,;:]?)([0-9A-Fa-f]{8}|[0-9A-Fa-f]{4}|[0-9A-Fa-f]{2})(\s*)")
_DIGITS = re.compile(r"[-\d.]+")
_KEYED = re.compile(r"([A-Za-z_][\w.]*\s*[=:]\s*)(.*)", re.DOTALL)
_SUMS: Mapping[int, Sequence[Callable[[bytes], int]]] = {
    2: (lambda data: reduce(xor, data, 0), lambda data: sum(data) & 0xFF, lambda data: -sum(data) & 0xFF),
    4: (lambda data: crc_hqx(data, 0), lambda data: crc_hqx(data, 0xFFFF)),
    8: (zlib.crc32,),
}
"""Check sums by their number of hexadecimal digits."""


class _Check(NamedTuple):
    """A check sum at the end of texts: which it is, and whether it is that of the text with what stands around it."""

    digits: int
    number: int
    first: bool
    mark: bool

    def of(self, start: str, body: str, mark: str) -> int:
        """Return the check sum of a text."""
        summed = (start if self.first else "") + body + (mark if self.mark else "")
        return _SUMS[self.digits][self.number](summed.encode(errors="surrogateescape"))

    def holds(self, text: str) -> bool:
        """Return whether a text has this check sum."""
        found = _SUMMED.fullmatch(text)
        if found is None or len(found[4]) != self.digits:
            return False
        return int(found[4], 16) == self.of(found[1], found[2], found[3])


def structured(texts: Sequence[str]) -> Iterator[SuggestedValue]:
    """Yield changed texts of a field, from all the different texts that it has in a log; nothing without a structure.

    Parts are blank, missing, repeated, exchanged with the next, or another number or word; some are added at the end.
    Check sums are right, but for one text of each kind.
    """
    if not texts:
        return
    if all(map(_is_document, texts)):
        yield from _of_document(texts[0])
        return
    check = _check_of(texts)
    bodies = [_SUMMED.fullmatch(text) for text in texts] if check else []
    plain = [found[2] for found in bodies if found] if check else list(texts)
    delimiter = _delimiter_of(plain)
    if not delimiter:
        return
    form = "x" if any(found and found[4] != found[4].upper() for found in bodies) else "X"
    kinds: dict[tuple[str, int], int] = {}
    for number, text in enumerate(plain):
        parts = text.split(delimiter)
        kinds.setdefault((_DIGITS.sub("", parts[0]), len(parts)), number)
    for number in list(kinds.values())[:_KINDS]:
        found = bodies[number] if check else None
        for parts, reason in _changes(plain[number].split(delimiter)):
            body = delimiter.join(parts)
            if found and check:
                total = check.of(found[1], body, found[3])
                body = f"{found[1]}{body}{found[3]}{total:0{check.digits}{form}}{found[5]}"
            yield SuggestedValue(body, reason)
        if found and check:
            wrong = f"{int(found[4], 16) ^ 1:0{check.digits}{form}}"
            yield SuggestedValue(f"{found[1]}{found[2]}{found[3]}{wrong}{found[5]}", "the check sum is wrong")


def _changes(parts: Sequence[str]) -> Iterator[tuple[list[str], str]]:
    """Yield lists of parts with one change, and what it is."""
    for at, part in enumerate(parts[:_PARTS]):
        before, behind, name = [*parts[:at]], [*parts[at + 1 :]], f"part {at + 1}"
        keyed = _KEYED.fullmatch(part)
        key, value = (keyed[1], keyed[2]) if keyed else ("", part)
        yield [*before, key, *behind], f"{name} is blank"
        yield [*before, *behind], f"{name} is missing"
        yield [*before, part, part, *behind], f"{name} comes twice"
        others = ("0", f"-{value}", "9" * 20, "nan", "?") if _is_number(value) else ("0", "?", value + value)
        for other in others:
            if other != value:
                yield [*before, key + other, *behind], f"{name} is {other[:24]}"
    for at, (part, after) in enumerate(pairwise(parts[:_PARTS])):
        if part != after:
            yield [*parts[:at], after, part, *parts[at + 2 :]], f"parts {at + 1} and {at + 2} are exchanged"
    yield [*parts, ""], "a blank part is added"
    yield [*parts[: len(parts) // 2]], "the second half of the parts is missing"


def _delimiter_of(texts: Sequence[str]) -> str:
    """Return what stands most often between the parts of all texts; empty if nothing does."""
    counts = {each: min(text.count(each) for text in texts) for each in _SURE + _LIKELY}
    counts = {each: count for each, count in counts.items() if count > (each in _LIKELY)}
    return max(counts, key=lambda each: counts[each], default="")


def _check_of(texts: Sequence[str]) -> _Check | None:
    """Return the check sum that all texts have; two texts that differ do not have one by chance, more seldom yet."""
    if len(texts) < 2:
        return None
    every = (
        _Check(digits, number, first, mark)
        for digits, sums in _SUMS.items()
        for number in range(len(sums))
        for first in (False, True)
        for mark in (False, True)
    )
    return next((check for check in every if all(map(check.holds, texts))), None)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _is_document(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict | list)
    except ValueError:
        return False


def _of_document(text: str) -> Iterator[SuggestedValue]:
    """Yield changes of a JSON document within a text."""
    kind, payload = JsonType(), text.encode()
    for leaf in kind.leaves(payload, elements=2):
        if parse_path(leaf.path).length:
            continue
        yield SuggestedValue(kind.omit(payload, leaf.path, instead="null").decode(), f"{leaf.path} is null")
        for other in ("", "?") if isinstance(leaf.value, str) else (0, -1, 2**63 - 1, float("nan")):
            yield SuggestedValue(kind.patch(payload, {leaf.path: other}).decode(), f"{leaf.path} is {other!r}")
        if not leaf.path.endswith("]"):
            yield SuggestedValue(kind.omit(payload, leaf.path).decode(), f"{leaf.path} is missing")
