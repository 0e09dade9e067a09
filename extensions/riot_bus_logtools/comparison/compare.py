"""Comparison of two recordings, topic by topic; pure."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from riot_bus_logtools.comparison.anchors import Gap, anchored, longest_rising
from riot_bus_logtools.comparison.fields import Reading, Shapes, differing
from riot_bus_logtools.comparison.pairing import Half, Pairing, paired
from riot_bus_logtools.comparison.parts import TopicDifference, TopicTiming
from riot_bus_logtools.comparison.recording import Recording, Track
from riot_bus_logtools.comparison.result import ComparedLog, LogDifference, OrderDifference
from riot_bus_logtools.comparison.tally import Tally
from riot_bus_logtools.comparison.tolerances import TolerancesOfTopic, TopicTolerances

_NUMBERS = 100  # of each kind in a report; one that lists all losses could be huge
_BINS = 120  # stretches of a log, as fleet.near_misses.BINS
_IN_MEMORY = 1 << 21  # values of messages: 64 MiB at _BYTES_PER_VALUE; beyond it, messages are read again
_BYTES_PER_VALUE = 32  # a Python float takes 24 bytes, the reference to it 8


class TopicComparison:
    """Compares the messages of one topic.

    Messages with equal bytes are found by hashes alone. `wanted` tells of which other messages the content is needed;
    when both recordings have kept those, `look` compares them.
    """

    def __init__(
        self,
        recordings: tuple[Recording, Recording],
        tracks: tuple[Track, Track],
        tolerances: TolerancesOfTopic,
    ) -> None:
        self.tracks = tracks
        self._recordings, self._tolerances = recordings, tolerances
        a, b = tracks
        blocks, self._gaps = anchored(a.hashes, b.hashes, Gap(range(len(a)), range(len(b))))
        self._pairing = Pairing(blocks)
        self._shapes = Shapes(tolerances, attachments=a.attachments and b.attachments)
        self._readings: dict[tuple[int, int], Reading] = {}
        self._room = _IN_MEMORY
        self._tally = Tally()
        self._opaque: Counter[str] = Counter()

    @property
    def wanted(self) -> tuple[list[range], list[range]]:
        """Positions of the messages of both logs of which the content is needed."""
        return [gap.a for gap in self._gaps if gap.a], [gap.b for gap in self._gaps if gap.b]

    def look(self) -> None:
        """Pair the wanted messages, and compare them."""
        halves = [Half(track.hashes, partial(self._read, side)) for side, track in enumerate(self.tracks)]
        found = self._pairing = paired(self._pairing.blocks, self._gaps, *halves, same=self._same)
        times, start = self.tracks[0].times, self._recordings[0].start
        for one, other in found.pairs:
            a, b = self._read(0, one), self._read(1, other)
            changes = differing(a, b, self._tolerances)
            self._tally.take(changes, one, other, (times[one] - start) / 1e9)
            if a.opaque or b.opaque:
                self._opaque[a.opaque or b.opaque] += 1
        self._readings.clear()

    @property
    def pairs(self) -> NDArray[np.int64]:
        """Positions of paired messages, shape (pairs, 2), increasing."""
        found = self._pairing
        parts = [np.arange(block.size)[:, None] + np.array([[block.a, block.b]]) for block in found.blocks]
        rows = np.concatenate([np.array(found.pairs, np.int64).reshape(-1, 2), *parts])
        return rows[np.argsort(rows[:, 0])]

    def result(self, *, starts: tuple[int, int], timing: float | None) -> TopicDifference:
        """Return the differences, given the times of the first message in common, and the seconds allowed, if any."""
        (a, b), found, tally, pairs = self.tracks, self._pairing, self._tally, self.pairs
        longest = max(len(a), len(b))
        return TopicDifference(
            topic=a.topic,
            type=a.type or b.type,
            count_a=len(a),
            count_b=len(b),
            equal=len(pairs) - tally.changed,
            near=tally.near,
            changed=tally.changed,
            lost=len(found.lost),
            added=len(found.added),
            moved=len(found.moved),
            unaligned=(sum(len(gap.a) for gap in found.unaligned), sum(len(gap.b) for gap in found.unaligned)),
            fields=tally.fields(),
            left=dict(sorted(tally.left.items(), key=lambda each: -each[1])),
            same_fields=tally.same_fields,
            opaque=dict(self._opaque),
            lost_at=tuple(found.lost[:_NUMBERS]),
            added_at=tuple(found.added[:_NUMBERS]),
            moved_at=tuple(found.moved[:_NUMBERS]),
            allowed=self._tolerances.messages.of(longest, longest),
            timing=_timing(pairs, (a, b), starts, timing) if len(pairs) else None,
            labels=dict(_labels(a, b)),
            profile=_profile([*tally.changed_at, *found.lost, *(one for one, _ in found.moved)], len(a)),
        )

    def _read(self, side: int, place: int) -> Reading:
        found = self._readings.get((side, place))
        if found is None:
            recording, track = self._recordings[side], self.tracks[side]
            found = self._shapes.read(recording.message(track.key, place), recording.registry)
            self._room -= len(found.values) + len(found.message.payload) // _BYTES_PER_VALUE
            if self._room > 0:
                self._readings[side, place] = found
        return found

    def _same(self, one: int, other: int) -> bool:
        return all(each.allowed for each in differing(self._read(0, one), self._read(1, other), self._tolerances))


def _labels(a: Track, b: Track) -> list[tuple[str, tuple[str, str]]]:
    """Return the properties of all messages that differ between the logs."""
    encodings = [", ".join(sorted(track.encodings - {""})) for track in (a, b)]
    told = [("type", (a.type, b.type)), ("encoding", (encodings[0], encodings[1]))]
    return [(name, both) for name, both in told if all(both) and both[0] != both[1]]


def _profile(places: Sequence[int], count: int) -> tuple[float, ...]:
    if not places:
        return ()
    bins = min(count, _BINS)
    borders = np.linspace(0, count, bins + 1)
    shares = np.histogram(places, borders)[0] / np.histogram(np.arange(count), borders)[0]
    return tuple(shares.tolist())


def _timing(
    pairs: NDArray[np.int64], tracks: tuple[Track, Track], starts: tuple[int, int], limit: float | None
) -> TopicTiming:
    times = [np.frombuffer(track.times, np.int64)[pairs[:, side]] - starts[side] for side, track in enumerate(tracks)]
    apart = np.abs(times[1] - times[0]) / 1e9
    worst = int(apart.argmax())
    late = 0 if limit is None else int(np.count_nonzero(apart > limit))
    return TopicTiming(float(np.median(apart)), float(apart[worst]), int(pairs[worst, 0]), late)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What counts as a difference: values, messages off by more than `timing` seconds (None: never), another order."""

    tolerances: TopicTolerances = field(default_factory=TopicTolerances)
    timing: float | None = None
    order: bool = False


def compare(a: Recording, b: Recording, wishes: Wishes | None = None) -> LogDifference:
    """Compare two recordings."""
    wishes = wishes or Wishes()
    work: list[TopicComparison] = []
    ignored: list[str] = []
    for tracks in _matched(a, b):
        sides = [*zip((a, b), tracks, strict=True)]
        rules = wishes.tolerances.of_topic(partial(_include, sides))
        if rules.messages.leave:
            ignored.append(tracks[0].topic)
        else:
            work.append(TopicComparison((a, b), tracks, rules))
    for side, recording in enumerate((a, b)):
        recording.keep({each.tracks[side].key: each.wanted[side] for each in work})
    for each in work:
        each.look()
    order, starts = _across(work)
    topics = [each.result(starts=starts, timing=wishes.timing) for each in work]
    topics.sort(key=lambda each: (each.same, each.topic))
    every = [(one, track) for one in (a, b) for track in one.tracks.values()]
    unused = wishes.tolerances.unused(partial(_include, every))
    notes = tuple(f"the tolerance {text!r} names no topic of these logs" for text in unused)
    logs = [
        ComparedLog(one.name, sum(len(each.tracks[side]) for each in work), tuple(one.missing))
        for side, one in enumerate((a, b))
    ]
    return LogDifference(
        logs[0], logs[1], tuple(topics), OrderDifference(*order, counts=wishes.order), tuple(ignored), notes
    )


def _matched(a: Recording, b: Recording) -> list[tuple[Track, Track]]:
    """Pair the topics of both by key, otherwise by name; a topic of only one of them gets an empty partner."""
    left = dict(b.tracks)
    pairs = {key: left.pop(key) for key in a.tracks if key in left}
    names: defaultdict[str, list[Track]] = defaultdict(list)
    for track in left.values():
        names[track.topic.strip("/")].append(track)
    for key, track in a.tracks.items():
        alike = names[track.topic.strip("/")]
        if key not in pairs and alike:
            pairs[key] = alike.pop(0)
    found = [(track, pairs.get(key) or _none(track)) for key, track in a.tracks.items()]
    return found + [(_none(track), track) for tracks in names.values() for track in tracks]


def _none(track: Track) -> Track:
    return Track(track.key, track.topic, "", track.attachments)


def _include(tracks: Iterable[tuple[Recording, Track]], text: str) -> bool:
    """Return whether a name or key expression includes one of these tracks."""
    return any(
        track.topic.strip("/") == text.strip("/")
        or text in (track.topic, track.key)
        or recording.registry.matches(text, track.key)
        for recording, track in tracks
    )


def _across(work: Sequence[TopicComparison]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return how many messages both logs have, how many of them are in another order, and the times of the first."""
    rows: list[NDArray[np.int64]] = [np.zeros((0, 4), np.int64)]
    for each in work:
        pairs = each.pairs
        columns = [
            np.frombuffer(getattr(track, name), np.int64)[pairs[:, side]]
            for name in ("places", "times")
            for side, track in enumerate(each.tracks)
        ]
        rows.append(np.stack(columns, axis=1) if len(pairs) else rows[0])
    every = np.concatenate(rows)
    every = every[np.argsort(every[:, 0])]
    if not len(every):
        return (0, 0), (0, 0)
    kept = longest_rising(every[:, 1].tolist())
    return (len(every), len(every) - len(kept)), (int(every[0, 2]), int(every[0, 3]))
