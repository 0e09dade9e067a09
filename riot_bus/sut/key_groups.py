"""Grouping of keys that differ only by a number or an id into one key expression, if it is unambiguous; pure."""

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
    """Return keys by group: by the key itself, or by a key expression for several similar keys.

    An expression stands for keys that differ only by the number or id of one chunk and have the same properties, if it
    includes no other key. If several expressions fit a key, the one with most keys counts; if there is a tie, none.

    Args:
        alike: Properties of each key that must be the same within a group.
        others: Further existing keys, which are not grouped.

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
