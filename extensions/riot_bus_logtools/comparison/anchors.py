"""Matching of messages of two sequences by keys alone: equal keys at the ends, and keys that occur once.

A longest common subsequence of all messages would take time that grows with the square of their number. So only keys
that occur once in both sequences are aligned, as in patience sorting, and the messages between them are left to a
caller that can look into them.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

Keys = Sequence[Hashable] | Mapping[int, Hashable]
"""The key of each message, by position; None for a message without a key, which equals no other one."""

_SHARE = 0.5  # of the shorter sequence: if fewer keys are equal, this may be by chance


class Twins(NamedTuple):
    """Messages that match: `a + n` and `b + n` for each n below `size`."""

    a: int
    b: int
    size: int


class Gap(NamedTuple):
    """Ranges of messages that are not matched yet."""

    a: range
    b: range

    def __bool__(self) -> bool:
        return bool(self.a or self.b)


def anchored(a: Keys, b: Keys, gap: Gap) -> tuple[list[Twins], list[Gap]]:
    """Return the matches within a gap, and the gaps that are left, in their order.

    Keys that occur once in both are used if those in the same order make up half of the shorter sequence: if only a
    few are equal, this may be by chance. Equal keys at the ends of a gap match even if they occur more than once.
    """
    head, middle, tail = _trimmed(a, b, gap)
    places = _common(a, b, middle)
    if not places or len(places) < _SHARE * min(len(middle.a), len(middle.b)):
        return head + tail, [middle] if middle else []
    blocks, gaps = head, []
    borders = [(middle.a.start - 1, middle.b.start - 1), *places, (middle.a.stop, middle.b.stop)]
    for (a0, b0), (a1, b1) in pairwise(borders):
        between = Gap(range(a0 + 1, a1), range(b0 + 1, b1))
        first, rest, last = _trimmed(a, b, between)
        blocks += first + last
        gaps += [rest] if rest else []
        if a1 < middle.a.stop:
            blocks.append(Twins(a1, b1, 1))
    return list(_joined(blocks + tail)), gaps


def longest_rising(numbers: Sequence[int]) -> list[int]:
    """Return the positions of a longest increasing subsequence of distinct numbers.

    Example:
        >>> longest_rising([2, 0, 1, 5, 3, 4])
        [1, 2, 4, 5]
    """
    tops: list[int] = []
    at: list[int] = []
    before: list[int] = []
    for place, number in enumerate(numbers):
        length = bisect_left(tops, number)
        before.append(at[length - 1] if length else -1)
        if length == len(tops):
            tops.append(number)
            at.append(place)
        else:
            tops[length], at[length] = number, place
    found: list[int] = []
    place = at[-1] if at else -1
    while place >= 0:
        found.append(place)
        place = before[place]
    return found[::-1]


def _trimmed(a: Keys, b: Keys, gap: Gap) -> tuple[list[Twins], Gap, list[Twins]]:
    """Return what is equal at the beginning, the rest, and what is equal at the end."""
    (a0, a1), (b0, b1) = (gap.a.start, gap.a.stop), (gap.b.start, gap.b.stop)
    start_a, start_b, stop_a = a0, b0, a1
    while a0 < a1 and b0 < b1 and a[a0] == b[b0] and a[a0] is not None:
        a0, b0 = a0 + 1, b0 + 1
    while a1 > a0 and b1 > b0 and a[a1 - 1] == b[b1 - 1] and a[a1 - 1] is not None:
        a1, b1 = a1 - 1, b1 - 1
    head = [Twins(start_a, start_b, a0 - start_a)] if a0 > start_a else []
    tail = [Twins(a1, b1, stop_a - a1)] if stop_a > a1 else []
    return head, Gap(range(a0, a1), range(b0, b1)), tail


def _common(a: Keys, b: Keys, gap: Gap) -> list[tuple[int, int]]:
    """Return the positions of the most keys that occur once in both and are in the same order."""
    once = [Counter(keys[place] for place in places) for keys, places in ((a, gap.a), (b, gap.b))]
    there = {b[place]: place for place in gap.b if once[1][b[place]] == 1 and b[place] is not None}
    both = [(place, there[a[place]]) for place in gap.a if once[0][a[place]] == 1 and a[place] in there]
    return [both[number] for number in longest_rising([place for _, place in both])]


def _joined(blocks: Sequence[Twins]) -> Iterator[Twins]:
    """Yield the blocks, with adjacent ones merged."""
    last = Twins(0, 0, 0)
    for block in blocks:
        if last.size and (block.a, block.b) == (last.a + last.size, last.b + last.size):
            last = last._replace(size=last.size + block.size)
            continue
        if last.size:
            yield last
        last = block
    if last.size:
        yield last
