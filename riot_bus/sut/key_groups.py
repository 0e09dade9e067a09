"""Keys that differ by a number or an id alone, as one key expression, where that is clear; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING

from riot_bus.vocabulary.selector import key_matches

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Mapping

__all__ = ["grouped"]

_ID = re.compile(r"[0-9]{1,20}|[0-9a-fA-F]{16,64}|[0-9a-fA-F]{8}(?:-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")


def grouped(alike: Mapping[str, Hashable], others: Collection[str] = ()) -> dict[str, list[str]]:
    """Return keys by what includes them: the key itself, or a key expression for several that are alike.

    An expression stands for keys that differ by the number or id of one chunk and are alike otherwise, if it includes
    no other key. Of several expressions for a key the one with most keys counts; none if these are several.

    Args:
        alike: What keys must have in common besides, by key.
        others: Further keys that there are.

    Example:
        >>> grouped({"robot/1/pose": "json", "robot/2/pose": "json", "robot/2/map": "raw"})
        {'robot/*/pose': ['robot/1/pose', 'robot/2/pose'], 'robot/2/map': ['robot/2/map']}
    """
    families: defaultdict[tuple[str, Hashable], list[str]] = defaultdict(list)
    for key, what in alike.items():
        chunks = key.split("/")
        for number, chunk in enumerate(chunks):
            if _ID.fullmatch(chunk):
                families["/".join((*chunks[:number], "*", *chunks[number + 1 :])), what].append(key)
    every, sizes = {*alike, *others}, defaultdict[str, list[int]](list)
    clear = {}
    for (expression, _), keys in families.items():
        if len(keys) > 1 and not any(key_matches(expression, key) for key in every.difference(keys)):
            clear[expression] = keys
            for key in keys:
                sizes[key].append(len(keys))
    found = {
        expression: sorted(keys)
        for expression, keys in sorted(clear.items())
        if all(max(sizes[key]) == len(keys) and sizes[key].count(len(keys)) == 1 for key in keys)
    }
    taken = {key for keys in found.values() for key in keys}
    return {**found, **{key: [key] for key in alike if key not in taken}}
