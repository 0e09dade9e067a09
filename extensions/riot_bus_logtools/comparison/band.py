"""Matching of messages of two sequences by similarity: an alignment of least cost, within a band.

A message that is lost or added costs 1, and so does a pair that differs; how far apart the two of a pair are adds a
little, which breaks ties. Only pairs whose positions differ by little more than the lengths of the sequences are
considered (Ukkonen, "Algorithms for approximate string matching", 1985): time and memory are bounded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Costs = Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float64]]
"""Returns the costs of pairs from their positions, of shape (n, 1) in one sequence and (n, m) in the other one."""

MOST_CELLS = 1 << 24
"""Most pairs that are considered; if even the narrowest band has more, nothing is aligned."""

_WIDTHS = (2, 32)  # 2 suffices if fewer than 6 messages differ; 32 takes up to 13 times as long
_AT_ONCE = 1 << 15  # pairs: with likeness.MOST_FIELDS (32) fields, an array of them takes 8 MiB
_PAIR, _LOST, _ADDED = range(3)  # the ways into a cell
_CLEAR = 1e-9  # above rounding errors: one of a sum of 100,000 costs is 1.5e-11


def aligned(costs: Costs, count_a: int, count_b: int) -> list[tuple[int, int]] | None:
    """Return the pairs of an alignment, increasing in both; None if it would take too long."""
    if count_a > count_b:
        turned = aligned(lambda rows, columns: costs(columns, rows), count_b, count_a)
        return None if turned is None else [(a, b) for b, a in turned]
    found: list[tuple[int, int]] | None = None
    longer = count_b - count_a
    for width in _WIDTHS:
        width = min(width, count_b)
        if count_a * (longer + 2 * width + 1) > MOST_CELLS:
            break
        found, cost = _within(costs, count_a, count_b, width)
        if cost < longer + 2 * (width + 1):  # an alignment that leaves the band costs more
            break
    return found


def _within(costs: Costs, count_a: int, count_b: int, width: int) -> tuple[list[tuple[int, int]], float]:
    """Return pairs and their cost; column k of row i aligns the first i messages with the first i + k - width."""
    offsets = np.arange(-width, count_b - count_a + width + 1)
    steps = np.arange(len(offsets), dtype=np.float64)
    best = np.where(offsets >= 0, offsets, np.inf).astype(np.float64)
    ways = np.full((count_a + 1, len(offsets)), _ADDED, np.uint8)
    rows = max(1, _AT_ONCE // len(offsets))
    for begin in range(0, count_a, rows):
        places = np.arange(begin, min(count_a, begin + rows))[:, None]
        columns = places + offsets[None, :]
        block = costs(places, columns.clip(0, count_b - 1))
        block[(columns < 0) | (columns >= count_b)] = np.inf
        for number, row in enumerate(block, begin + 1):
            best = _row(best, row, ways[number], steps)
            best[(offsets < -number) | (offsets > count_b - number)] = np.inf
    return _walked(ways, count_a, count_b - count_a + width, width), float(best[count_b - count_a + width])


def _row(best: NDArray[Any], costs: NDArray[Any], ways: NDArray[np.uint8], steps: NDArray[Any]) -> NDArray[Any]:
    """Return the costs of a row from those of the row before, and record the steps in `ways`."""
    paired = best + costs
    lost = np.append(best[1:], np.inf) + 1.0
    either = np.minimum(paired, lost)
    least: NDArray[Any] = np.minimum.accumulate(either - steps) + steps
    ways[:] = np.where(lost < paired, _LOST, _PAIR)
    ways[either > least + _CLEAR] = _ADDED
    return least


def _walked(ways: NDArray[np.uint8], row: int, column: int, width: int) -> list[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    while row or column > width:
        way = ways[row, column]
        if way == _ADDED:
            column -= 1
            continue
        row -= 1
        if way == _LOST:
            column += 1
        else:
            found.append((row, row + column - width))
    return found[::-1]
