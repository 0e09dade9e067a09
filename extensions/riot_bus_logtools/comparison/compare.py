"""Comparison of two recordings, topic by topic; pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from riot_bus_logtools.comparison.anchors import longest_rising
from riot_bus_logtools.comparison.recording import Track
from riot_bus_logtools.comparison.result import ComparedLog, LogDifference, OrderDifference
from riot_bus_logtools.comparison.tolerances import TopicTolerances
from riot_bus_logtools.comparison.topics import TopicComparison

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from riot_bus_logtools.comparison.recording import Recording
    from riot_bus_logtools.comparison.tolerances import TolerancesOfTopic


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What counts as a difference.

    Attributes:
        tolerances: Distances that values may have, and numbers of messages that may be missing.
        timing: Seconds by which messages may be earlier or later; None for any.
        order: Whether the order across topics has to be the same.
    """

    tolerances: TopicTolerances = field(default_factory=TopicTolerances)
    timing: float | None = None
    order: bool = False


def compare(a: Recording, b: Recording, wishes: Wishes | None = None) -> LogDifference:
    """Compare two recordings."""
    wishes = wishes or Wishes()
    work: list[TopicComparison] = []
    ignored: list[str] = []
    for tracks in _matched(a, b):
        rules = _rules(wishes.tolerances, a, b, tracks)
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
    unused = wishes.tolerances.unused(
        lambda text: any(_includes(text, one, track) for one in (a, b) for track in one.tracks.values())
    )
    notes = tuple(f"the tolerance {text!r} names no topic of these logs" for text in unused)
    sides = [
        ComparedLog(one.name, sum(len(each.tracks[side]) for each in work), tuple(one.missing))
        for side, one in enumerate((a, b))
    ]
    return LogDifference(
        sides[0], sides[1], tuple(topics), OrderDifference(*order, counts=wishes.order), tuple(ignored), notes
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


def _includes(text: str, recording: Recording, track: Track) -> bool:
    named = track.topic.strip("/") == text.strip("/") or text in (track.topic, track.key)
    return named or recording.registry.matches(text, track.key)


def _rules(tolerances: TopicTolerances, a: Recording, b: Recording, tracks: tuple[Track, Track]) -> TolerancesOfTopic:
    return tolerances.of_topic(
        lambda text: any(_includes(text, one, track) for one, track in zip((a, b), tracks, strict=True))
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
