"""Recorded series of different rates aligned to the messages of one: the value of each field when it was sent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riot_bus.backchain.fir import Floats, Ints, standardise

FEWEST_CHANGES = 5
"""A field with fewer changes over all logs is not judged: they may meet another field's by chance."""

_FEWEST_ROWS = 8
_FEWEST_IN_ALL = 40
_MOST_ROWS = 10_000
"""Most rows of a response in total: more change no verdict, but cost memory and time."""


HALF_A_STEP = (False, False, True, True)
"""Which variants lie half a step earlier: at a delay of whole steps, jitter decides which row shows the effect."""


@dataclass(frozen=True, slots=True)
class Piece:
    """One log, or a stretch of one."""

    times: Mapping[str, Floats]
    values: Mapping[str, NDArray[Any]]
    log: int = 0


@dataclass(slots=True)
class Response:
    """One internal field, at its own messages.

    Attributes:
        times: Times of each part's rows, in seconds.
        step: Median time between its messages, in seconds.
    """

    name: str
    pieces: list[int] = field(default_factory=list)
    times: list[Floats] = field(default_factory=list)
    values: list[Floats] = field(default_factory=list)
    step: float = 0.0

    @property
    def rows(self) -> int:
        """Number of messages used, over all parts."""
        return sum(map(len, self.times))


@dataclass(frozen=True, slots=True)
class Variants:
    """One candidate at the rows of a response: its value then and half a step earlier, each followed by its square.

    If the candidate is faster than the response, its mean since the previous row comes last.

    Attributes:
        parts: For each part of the response one row per variant, standardised (variants x samples).
        age: Median age of the candidate's latest message at a row, in seconds.
        changes: Number of its changes from the first row of a part to the last, over all parts.
        rows: Number of rows in parts in which it changed, the basis of evidence.
    """

    parts: tuple[NDArray[np.float32], ...]
    age: float
    changes: int
    rows: int
    logs: int


def topic_of(name: str) -> str:
    """Return the topic of a field `topic:path`."""
    return name.rpartition(":")[0]


def response_of(pieces: Sequence[Piece], name: str) -> Response | str:
    """Return a field as a response, or why it cannot be one."""
    topic = topic_of(name)
    found = Response(name)
    known = [number for number, piece in enumerate(pieces) if name in piece.values]
    if not known:
        return "no log has it"
    most = max(_FEWEST_ROWS, _MOST_ROWS // len(known))
    count = 0
    for number in known:
        times, values = pieces[number].times[topic], np.asarray(pieces[number].values[name], dtype=np.float64)
        good = np.isfinite(values)
        times, values = times[good], values[good]
        count += len(times)
        first = max(0, (len(times) - most) // 2)
        times, values = times[first : first + most], standardise(values[first : first + most])
        if len(times) >= _FEWEST_ROWS and values.any():
            found.pieces.append(number)
            found.times.append(times)
            found.values.append(values)
    if not found.pieces:
        return "it never changes within a log" if count >= _FEWEST_ROWS else f"it has {count} values"
    if found.rows < _FEWEST_IN_ALL:
        return f"{found.rows} values are too few to tell (at least {_FEWEST_IN_ALL})"
    found.step = float(np.median(np.concatenate([np.diff(one) for one in found.times])))
    return found


def held_variants(pieces: Sequence[Piece], name: str, response: Response) -> Variants | str:
    """Return a candidate at the rows of a response, or why it cannot be judged."""
    topic = topic_of(name)
    parts: list[Floats] = []
    ages: list[Floats] = []
    changes, seen = 0, False
    faster = _is_faster(pieces, topic, response)
    for number, rows in zip(response.pieces, response.times, strict=True):
        piece = pieces[number]
        values = np.asarray(piece.values.get(name, ()), dtype=np.float64)
        good = np.isfinite(values)
        if not good.any():
            parts.append(np.zeros((len(HALF_A_STEP) + faster, len(rows))))
            continue
        times, values = piece.times[topic][good], values[good]
        seen = True
        place: Ints = np.searchsorted(times, rows, side="right") - 1
        ages.append((rows - times[np.maximum(place, 0)])[place >= 0])
        place = np.maximum(place, 0)
        held = values[place]
        changes += int(np.count_nonzero(np.diff(values[place[0] : place[-1] + 1])))
        variants = []
        for one in (held, values[np.maximum(np.searchsorted(times, rows - response.step / 2, side="right") - 1, 0)]):
            level = standardise(one)
            variants += [level, standardise(level**2)]
        if faster:
            variants.append(standardise(_means(values, place)))
        parts.append(np.stack(variants))
    if not seen:
        return "no log has it beside the field that is asked for"
    if not any(part.any() for part in parts):
        return "it never changes within a log"
    if changes < FEWEST_CHANGES:
        return f"it changes {changes} times in all logs, too few to tell (at least {FEWEST_CHANGES})"
    every = np.concatenate(ages)
    alive = [place for place, part in enumerate(parts) if part.any()]
    return Variants(
        tuple(part.astype(np.float32) for part in parts),
        float(np.median(every)) if len(every) else 0.0,
        changes,
        rows=sum(len(response.times[place]) for place in alive),
        logs=len({pieces[response.pieces[place]].log for place in alive}),
    )


def _is_faster(pieces: Sequence[Piece], topic: str, response: Response) -> bool:
    gaps = [np.diff(pieces[number].times[topic]) for number in response.pieces if topic in pieces[number].times]
    step = float(np.median(np.concatenate(gaps))) if sum(map(len, gaps)) else 0.0
    return step > 0 and response.step > 1.5 * step  # below, at least half of the means are of the held value alone


def _means(values: Floats, place: Ints) -> Floats:
    """Return the mean of the values since the previous row, or the held value if there are none."""
    sums = np.concatenate([[0.0], np.cumsum(values - values.mean())])
    before = np.concatenate([[max(int(place[0]) - 1, -1)], place[:-1]])
    count = place - before
    means: Floats = (sums[place + 1] - sums[before + 1]) / np.maximum(count, 1)
    return np.where(count > 0, means, values[place] - values.mean())
