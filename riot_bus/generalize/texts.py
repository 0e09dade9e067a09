"""Texts and bytes for trials: variations of known ones in length, beginning and alphabet."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import TypeVar

TextT = TypeVar("TextT", str, bytes)

LONGEST = 4096
"""Maximum length of variations, unless a known text is longer."""

_ALPHABETS = (
    "abcdefghijklmnopqrstuvwxyz",
    "ABCXYZ0123456789",
    "/._-: ",
    "0123456789",
    "\"'\\%{}$;#*\n\t\0",
    "éüß日本\u200b😀",
)


def resized(text: TextT, size: int) -> TextT:
    """Return a text of this length that begins with the given one as far as possible, and repeats it."""
    if size <= len(text):
        return text[:size]
    filling = text or (b"a" if isinstance(text, bytes) else "a")
    return text + (filling * (size // len(filling) + 1))[: size - len(text)]


def varied(known: Sequence[TextT], chance: random.Random) -> TextT:
    """Return a variation of a known text: cut, lengthened, with a letter added or replaced, or random letters."""
    base = chance.choice(known)
    kind = chance.randrange(6)
    if kind == 0:
        return base[: _size(chance, len(base))]
    if kind == 1:
        return resized(base or _letters(base, 1, chance), _size(chance, max(LONGEST, len(base))))
    place = min(chance.choice((0, len(base), chance.randint(0, len(base)))), LONGEST)
    if kind in (2, 3):
        return base[:place] + _letters(base, 1, chance) + base[place + (kind == 3) :]
    start = base[: chance.randint(1, 4)] if kind == 4 else base[:0]
    return start + _letters(base, _size(chance, 1024), chance)


def _size(chance: random.Random, most: int) -> int:
    return int((most + 1) ** chance.random()) - (chance.random() < 0.2)


def _letters(like: TextT, count: int, chance: random.Random) -> TextT:
    """Return random letters of one alphabet."""
    alphabet = chance.choice(_ALPHABETS)
    letters = "".join(chance.choice(alphabet) for _ in range(max(count, 0)))
    if isinstance(like, str):
        return letters
    return bytes(chance.randrange(256) for _ in letters) if chance.random() < 0.5 else letters.encode()
