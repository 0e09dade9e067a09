"""Recordings of small systems whose truth is known."""

from __future__ import annotations

import numpy as np

from riot_bus_fleet.evidence.alignment import Piece

STEP = 0.1


def text_of(hop, depth=0):
    """Return a tree of topics as indented lines."""
    marks = [word for word in ("external", "loop", "cut", "again") if getattr(hop, word)]
    via = f" via {hop.component}" if hop.component is not None else ""
    line = "  " * depth + hop.topic + via + (f" [{', '.join(marks)}]" if marks else "")
    return "\n".join([line, *(text_of(one, depth + 1) for one in hop.hops)])


def red(rng, count, keep=0.8):
    """Return noise with memory, of variance about 1."""
    kicks = rng.normal(size=count) * np.sqrt(1 - keep**2)
    found = np.empty(count)
    found[0] = kicks[0]
    for at in range(1, count):
        found[at] = keep * found[at - 1] + kicks[at]
    return found


def late(series, steps):
    return np.concatenate([np.full(steps, series[0]), series])[: len(series)]


def pieces(make, *, logs=4, count=300, seed=0):
    """Return logs of what `make(rng, count)` gives, series by topic at 10 Hz; `out` comes 50 ms after the others."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(logs):
        series = make(rng, count)
        times = {topic: np.arange(count) * STEP + (0.05 if topic == "out" else 0.0) for topic in series}
        found.append(Piece(times, {f"{topic}:v": values for topic, values in series.items()}, number))
    return found
