"""Pairing of the messages of a topic in two logs.

Messages are paired by equal bytes, then by equal content, then by the same stamp or sequence number, and finally by
similarity (`band`). Those that cannot be aligned in bounded time are reported as unaligned.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict, deque
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from riot_bus_logtools.comparison.anchors import Gap, Twins, anchored
from riot_bus_logtools.comparison.band import aligned
from riot_bus_logtools.comparison.likeness import Likeness, as_numbers, most_varied

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus_logtools.comparison.fields import Reading

_NAMED = 0.9
"""Least share of messages with a stamp or number of their own for which messages are paired by these."""
_MOST_TRIES = 1 << 14
"""Most pairs that are tried to find messages in another order that are only equal within tolerances."""


@dataclass(frozen=True, slots=True)
class Half:
    """One log's messages of the topic."""

    hashes: Sequence[bytes]
    read: Callable[[int], Reading]


@dataclass(slots=True)
class Pairing:
    """Messages by their positions in both logs.

    Attributes:
        blocks: Sequences of messages with equal bytes.
        pairs: Other messages that match, increasing in both logs.
        lost: Messages of the first log only.
        added: Messages of the second log only.
        moved: Messages that are the same in both, in another order.
        unaligned: Ranges of messages that could not be paired.
    """

    blocks: list[Twins]
    pairs: list[tuple[int, int]] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    added: list[int] = field(default_factory=list)
    moved: list[tuple[int, int]] = field(default_factory=list)
    unaligned: list[Gap] = field(default_factory=list)

    def add(self, other: Pairing) -> None:
        """Add the pairing of other messages."""
        self.pairs += other.pairs
        self.lost += other.lost
        self.added += other.added
        self.unaligned += other.unaligned


def paired(blocks: list[Twins], gaps: Sequence[Gap], a: Half, b: Half, *, same: Callable[[int, int], bool]) -> Pairing:
    """Pair the messages of both logs."""
    found = Pairing(blocks)
    search = _Search(gaps, a, b)
    for gap in gaps:
        search.take(gap, found)
    found.pairs.sort()
    search.find_moves(found)
    _find_near_moves(found, same)
    found.lost.sort()
    found.added.sort()
    found.moved.sort()
    return found


class _Search:
    """Pairs the messages in gaps by their fields."""

    def __init__(self, gaps: Sequence[Gap], a: Half, b: Half) -> None:
        self._halves = a, b
        self._a = _Keys(a, [place for gap in gaps for place in gap.a])
        self._b = _Keys(b, [place for gap in gaps for place in gap.b])

    def take(self, gap: Gap, found: Pairing) -> None:
        """Pair the messages in a gap by stamp or number, unless fewer messages differ when paired by similarity."""
        blocks, gaps = anchored(self._a.contents, self._b.contents, gap)
        found.pairs += _pairs(blocks)
        for rest in gaps:
            closeness = _Closeness(rest, *self._halves)
            alike, named = closeness.pairing(rest), self._named(rest, closeness)
            better = named is not None and closeness.cost(named) <= closeness.cost(alike)
            found.add(named if named is not None and better else alike)

    def _named(self, gap: Gap, closeness: _Closeness) -> Pairing | None:
        """Pair messages by stamp or number, and by similarity between these; None if stamps and numbers do not help."""
        if not (gap.a and gap.b and _tell(self._a.names, gap.a) and _tell(self._b.names, gap.b)):
            return None
        blocks, gaps = anchored(self._a.names, self._b.names, gap)
        found = Pairing([], [*_pairs(blocks)])
        for rest in gaps:
            found.add(closeness.pairing(rest))
        return found if blocks else None

    def find_moves(self, found: Pairing) -> None:
        """Turn messages that are lost and added with the same content into moved ones."""
        self._take_apart(found)
        there: defaultdict[Hashable, deque[int]] = defaultdict(deque)
        for place in sorted(found.added):
            there[self._b.contents[place]].append(place)
        lost, found.lost = sorted(found.lost), []
        for place in lost:
            same = there[self._a.contents[place]]
            if same:
                found.moved.append((place, same.popleft()))
            else:
                found.lost.append(place)
        found.added = [place for places in there.values() for place in places]

    def _take_apart(self, found: Pairing) -> None:
        """Split pairs of which both messages occur elsewhere in the other log.

        Messages that swapped positions far apart are at first paired with each other, as if they had changed. Only
        contents that occur once in each log show this. If the equal of a message stays in its pair, the message stays
        in its own pair as well.
        """
        there, here = self._b.only, self._a.only
        wants: dict[int, int] = {}
        wanted_by: dict[int, int] = {}
        apart: dict[int, int] = {}
        for one, other in found.pairs:
            contents = self._a.contents[one], self._b.contents[other]
            if contents[0] != contents[1] and all(each in there and each in here for each in contents):
                apart[one], wants[one], wanted_by[other] = other, there[contents[0]], here[contents[1]]
        partner = {other: one for one, other in apart.items()}
        free = {*found.lost, *apart}, {*found.added, *partner}
        queue = deque(apart)
        while queue:
            one = queue.popleft()
            if one in apart and not (wants[one] in free[1] and wanted_by[apart[one]] in free[0]):
                other = apart.pop(one)
                free[0].discard(one)
                free[1].discard(other)
                queue += [wanted_by[other], partner.get(wants[one], one)]
        found.pairs = [pair for pair in found.pairs if pair[0] not in apart]
        found.lost += apart
        found.added += apart.values()


class _Closeness:
    """The similarity of the messages in a gap."""

    def __init__(self, gap: Gap, a: Half, b: Half) -> None:
        self._gap = gap
        here, there = (gap.a, gap.b) if gap.a and gap.b else (range(0), range(0))  # else there is nothing to pair
        self._rules = most_varied([*map(a.read, _few(here)), *map(b.read, _few(there))])
        self._a, texts_a = as_numbers(map(a.read, here), [*self._rules])
        self._b, texts_b = as_numbers(map(b.read, there), [*self._rules])
        self._texts = texts_a | texts_b

    def pairing(self, gap: Gap) -> Pairing:
        """Pair the messages in a part of the gap by similarity."""
        if not (gap.a and gap.b):
            return Pairing([], lost=[*gap.a], added=[*gap.b])
        places = aligned(self._likeness(gap.a, gap.b).costs, len(gap.a), len(gap.b))
        if places is None:
            return Pairing([], unaligned=[gap])
        pairs = [(gap.a[one], gap.b[other]) for one, other in places]
        lost = sorted(set(gap.a) - {one for one, _ in pairs})
        return Pairing([], pairs, lost, sorted(set(gap.b) - {other for _, other in pairs}))

    def cost(self, found: Pairing) -> tuple[float, int]:
        """Return how many messages differ, are lost or added (infinite if unaligned), and without those that differ."""
        alone = len(found.lost) + len(found.added)
        if found.unaligned:
            return math.inf, alone
        rows = np.arange(len(found.pairs))[:, None]
        likeness = self._likeness([one for one, _ in found.pairs], [other for _, other in found.pairs])
        return float(np.floor(likeness.costs(rows, rows)).sum()) + alone, alone

    def _likeness(self, a: Sequence[int], b: Sequence[int]) -> Likeness:
        numbers = self._a[np.array(a, np.int64) - self._gap.a.start], self._b[np.array(b, np.int64) - self._gap.b.start]
        return Likeness(*numbers, texts=self._texts, rules=self._rules)


class _Keys:
    """Contents and names (stamps or numbers) of the messages of one log that are in gaps."""

    def __init__(self, half: Half, places: Sequence[int]) -> None:
        self.contents: dict[int, Hashable] = {}
        self.names: dict[int, Hashable] = {}
        for place in places:
            reading = half.read(place)
            self.contents[place], self.names[place] = reading.content(), reading.identity()
        self._hashes = half.hashes

    @cached_property
    def only(self) -> dict[Hashable, int]:
        """Positions of messages whose content is unique in the log, by content."""
        contents, hashes = Counter(self.contents.values()), Counter(self._hashes)
        return {
            content: place
            for place, content in self.contents.items()
            if contents[content] == 1 and hashes[self._hashes[place]] == 1
        }


def _find_near_moves(found: Pairing, same: Callable[[int, int], bool]) -> None:
    """Turn lost and added messages that are the same within tolerances into moved ones."""
    tries = _MOST_TRIES
    for one in list(found.lost):
        for other in found.added[: max(0, tries)]:
            tries -= 1
            if same(one, other):
                found.moved.append((one, other))
                found.lost.remove(one)
                found.added.remove(other)
                break


def _tell(names: Mapping[int, Hashable], places: range) -> bool:
    """Return whether the names of messages tell them apart."""
    known = [names[place] for place in places]
    return len(set(known)) >= _NAMED * len(known) and None not in known


def _pairs(blocks: Iterable[Twins]) -> Iterator[tuple[int, int]]:
    return ((block.a + number, block.b + number) for block in blocks for number in range(block.size))


def _few(places: Sequence[int]) -> Sequence[int]:
    return places[:: max(1, len(places) // 256)]  # enough to see which fields vary
