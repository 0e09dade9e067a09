"""Finds the recorded fields that an internal one follows in nominal logs: lagged dependence, conditional on the rest.

Nothing was perturbed here, so what is found is dependence, not proof of cause. The part that the field's own past
predicts is removed first: otherwise all slow fields would seem to follow each other, and a field that this one drives
would seem to drive it (Granger). The null distribution comes from random signs of blocks of time, the same for all
candidates and lags (wild cluster bootstrap), with the maximum over all of them (Westfall and Young). So neither
autocorrelation, nor times of rest and of activity, nor a single coincidence, however large, looks like evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from riot_bus.backchain.fir import Floats, Ints, fit_terms, memory_of
from riot_bus.backchain.strength import Share, estimate
from riot_bus_fleet.evidence.alignment import HALF_A_STEP, Response, Variants

Follows = Literal["level", "spread"]
"""Aspect of a response that follows a candidate: its value, or how much it varies."""

ALPHA = 0.01
"""Accepted chance that any source of a field is named wrongly."""

_ROUNDS = 12
_IDLE = 0.25
"""Candidates with more of their null distribution above them are not tested again, which saves most of the time."""

_OWN = (1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 24, 32, 48, 64)
"""Lags of the response's own past, in messages: all near ones, some far ones."""

_EXACT = 12
_MOST_LAGS = 400
"""Lags in messages: the first ones singly, then the mean over stretches that grow by a quarter, up to the horizon."""

_LONGEST_MEMORY = 0.999  # below 1, at which the changes of a constant part would be 0
_SMOOTH = 0.3
"""Above this autocorrelation, the changes of a candidate say more than its lags."""

_RIDGE = 1e-6
"""Share of the variance, so small that it only matters for matrices that would be singular."""

_OWN_PAST = ""
_TRIMS, _OUTLIER = 2, 6.0
_SHORTEST_BLOCK, _FEWEST_BLOCKS, _CORRELATED = 8, 20, 0.1
"""Blocks double in length until the residual correlates less than this over one, while enough blocks are left."""

_FULL = 0.95
_ROWS_PER_TERM = 40
"""Messages per term of a fit; with fewer, it would explain them by chance."""


_GROUPS = 10
"""Logs, or stretches of logs if there are fewer, over which a strength has to be consistent."""


@dataclass(frozen=True, slots=True)
class Dependence:
    """Result of the test whether an internal field follows a candidate.

    Attributes:
        found: Whether it stands out, given all others that do.
        p_value: Chance of such evidence, or stronger, from any candidate left, if the response followed none of them.
        follows: Aspect of the response that follows it; None if nothing was found.
        strength: Share that it explains of what the response's own past leaves open, 0 to 1; None if nothing was found.
        low: Lower end of its 95 % interval over logs.
        lag_s: Time from the candidate's message to the response that shows it most, in seconds.
        detectable: Share of what is left open at which a plain effect of one lag would have stood out in about half of
            all cases; None if so few messages could not have shown any.
    """

    name: str
    found: bool
    p_value: float
    follows: Follows | None = None
    strength: float | None = None
    low: float | None = None
    high: float | None = None
    lag_s: float | None = None
    detectable: float | None = None


@dataclass(frozen=True, slots=True)
class _Score:
    """The evidence of one candidate: observed, with random signs, and where it shows."""

    observed: float
    null: Floats
    follows: Follows
    column: int


def dependences(
    response: Response,
    candidates: Mapping[str, Variants],
    *,
    horizon: float = 2.0,
    draws: int = 199,
    alpha: float = ALPHA,
    seed: int = 0,
) -> list[Dependence]:
    """Find what a response follows among candidates.

    Args:
        horizon: Longest delay that is tested, in seconds (at least 12 messages of the response).
        alpha: Accepted chance that any candidate is named wrongly.

    Returns:
        Those found, strongest first, then the others by their evidence.
    """
    names = sorted(candidates)
    if not names:
        return []
    test = _Test(response, candidates, horizon=horizon, draws=draws, seed=seed)
    selected: list[str] = []
    p_values: dict[str, float] = {}
    scores: dict[str, _Score] = {}
    limit = 0.0
    left, settled = names, np.zeros(draws)
    for _ in range(_ROUNDS):
        left = [name for name in left if name not in selected]
        if not left:
            break
        found = test.scores(left, given=selected)
        scores |= found
        null = np.max([settled, *(one.null for one in found.values())], axis=0)
        limit = float(np.quantile(null, 1 - alpha))
        p_values |= {name: _share_above(null, one.observed) for name, one in found.items()}
        best = max(left, key=lambda name: found[name].observed)
        if p_values[best] > alpha:
            break
        selected.append(best)
        # Those that show nothing at all are not tested again, but stay in the null distribution.
        idle = [name for name in left if name != best and _share_above(found[name].null, found[name].observed) > _IDLE]
        settled = np.max([settled, *(found[name].null for name in idle)], axis=0)
        left = [name for name in left if name not in idle]
    for name in list(reversed(selected)):
        others = [one for one in selected if one != name]
        if others:
            (score,) = test.scores([name], given=others).values()
            p_value = _share_above(score.null, score.observed)
            if p_value > alpha:
                selected.remove(name)
                p_values[name] = p_value
    shares = test.shares(selected, scores)
    selected = [name for name in selected if shares[name].low > 0]  # else it differs from log to log
    result = [
        Dependence(
            name,
            found=True,
            p_value=p_values[name],
            follows=scores[name].follows,
            strength=shares[name].strength,
            low=shares[name].low,
            high=shares[name].high,
            lag_s=test.lag(name, scores[name].column),
        )
        for name in selected
    ]
    result.sort(key=lambda one: (one.follows == "spread", -(one.strength or 0.0), one.p_value, one.name))
    rest = sorted((name for name in names if name not in selected), key=lambda name: (p_values[name], name))
    # Few blocks have the same signs by chance; and even if all agree, the evidence is at most the root of their number.
    few = 2.0 ** (1 - test.blocks) > alpha or limit**2 > _FULL * test.blocks
    detectable = None if few else min(1.0, limit**2 / test.rows)
    return result + [Dependence(name, found=False, p_value=p_values[name], detectable=detectable) for name in rest]


def _share_above(null: Floats, observed: float) -> float:
    return float(1 + np.count_nonzero(null >= observed)) / (len(null) + 1)


class _Test:
    def __init__(
        self, response: Response, candidates: Mapping[str, Variants], *, horizon: float, draws: int, seed: int
    ) -> None:
        self.response, self.candidates, self.draws, self.seed = response, candidates, draws, seed
        sizes = [len(part) for part in response.values]
        self.bounds = np.cumsum([0, *sizes])
        self.rows = int(self.bounds[-1])
        usual = int(np.median(sizes))
        wanted = int(np.ceil(horizon / response.step)) if response.step > 0 else _EXACT
        self.stretches = _stretches(max(1, min(max(_EXACT, min(wanted, _MOST_LAGS)), usual // 4)))
        self.level = np.concatenate(response.values)
        own = [lag for lag in _OWN if lag <= max(1, usual // 10)][: max(1, self.rows // _ROWS_PER_TERM)]
        # All parts are concatenated, with enough zeros before each that no lag reaches the previous part.
        self._longest = own[-1]
        self._gap = max(self.stretches[-1][1], own[-1] + 1)
        self._places = np.concatenate(
            [np.arange(low, high) + (number + 1) * self._gap for number, (low, high) in enumerate(self._parts())]
        )
        self._known = {_OWN_PAST: self._lagged(self.level, [(lag, lag + 1) for lag in own]).T.astype(np.float64)}
        self._own = np.linalg.qr(self._known[_OWN_PAST])[0].astype(np.float32)
        self.blocks = 0
        self._products: dict[tuple[str, str], Floats] = {}

    def scores(self, names: Sequence[str], *, given: Sequence[str]) -> dict[str, _Score]:
        """Return the evidence of candidates for what the own past and given candidates leave of the response."""
        left = self._left(given)
        rows = self._blocks(left)
        self.blocks = len(rows)
        series = np.moveaxis(left[:, rows], 0, 2).astype(np.float32)
        rng = np.random.default_rng([self.seed, len(given)])
        signs = rng.choice(np.array([-1.0, 1.0], np.float32), size=(self.draws, len(rows)))
        return {name: self._score(name, series, rows, signs) for name in names}

    def _score(self, name: str, series: NDArray[Any], rows: Ints, signs: NDArray[Any]) -> _Score:
        columns = self.columns(name)
        # What the own past explains of a candidate adds nothing to the sums over all blocks, but much to their spread.
        columns -= (columns @ self._own) @ self._own.T
        count = len(columns)
        products = np.moveaxis(columns[:, rows], 0, 1) @ series  # blocks x columns x series
        both = np.moveaxis(products, 1, 2).reshape(len(rows), -1).astype(np.float64)
        spread = np.sqrt((both**2).sum(axis=0))
        usable = spread > 1e-3 * (float(spread.max()) or 1.0)  # of the rest only rounding is left
        scale = np.where(usable, spread, np.inf)
        observed = np.abs(both.sum(axis=0)) / scale
        best = int(observed.argmax())
        null = (np.abs(signs @ both) / scale).max(axis=1)
        follows: Follows = "spread" if best // count == 1 else "level"
        return _Score(float(observed[best]), null, follows, best % count)

    def _blocks(self, left: Floats) -> Ints:
        """Return the rows of each block: longer than the residual is correlated, and enough blocks to judge."""
        length = _SHORTEST_BLOCK
        usual = int(np.median(np.diff(self.bounds)))
        longest = max(_SHORTEST_BLOCK, min(self.rows // _FEWEST_BLOCKS, usual))
        while length < longest and max(self._correlation(one, length) for one in left) > _CORRELATED:
            length *= 2
        length = min(length, longest)
        starts = [np.arange(low, high - length + 1, length) for low, high in self._parts()]
        rows: Ints = np.concatenate(starts)[:, None] + np.arange(length)[None, :]
        return rows

    def _correlation(self, series: Floats, lag: int) -> float:
        pieces = [series[low:high] for low, high in self._parts() if high - low > lag]
        products = sum(float(one[lag:] @ one[:-lag]) for one in pieces)
        squares = sum(float(one @ one) for one in pieces)
        return products / squares if squares > 0 else 0.0

    def _parts(self) -> list[tuple[int, int]]:
        return list(zip(self.bounds[:-1].tolist(), self.bounds[1:].tolist(), strict=True))

    def _lagged(self, series: Floats, stretches: Sequence[tuple[int, int]]) -> Floats:
        """Return a series' means over stretches of lags, zero before its part (stretches x samples)."""
        gap, size = self._gap, self.rows + len(self.response.values) * self._gap
        padded = np.zeros(gap + size)
        padded[gap + self._places] = series
        sums = np.cumsum(padded)
        found: NDArray[Any] = np.empty((len(stretches), size), np.float32)
        for row, (first, last) in zip(found, stretches, strict=True):
            if last == first + 1:
                row[:] = padded[gap - first : gap - first + size]
            else:
                begin = gap - last
                row[:] = (sums[gap - first : gap - first + size] - sums[begin : begin + size]) / (last - first)
        lagged: Floats = found[:, self._places]
        return lagged

    def columns(self, name: str, *, changes: bool = True) -> Floats:
        """Return a candidate's variants, and its changes if it moves slowly, at all lags (columns x samples)."""
        rows = list(np.concatenate(self.candidates[name].parts, axis=1))
        memory = memory_of([part[0] for part in self.candidates[name].parts], low=0.0, high=_LONGEST_MEMORY)
        if changes and memory > _SMOOTH:
            change = rows[0] - memory * np.concatenate([rows[0][:1], rows[0][:-1]])
            change[self.bounds[:-1]] = 0.0
            rows.append(change)
        columns: Floats = np.concatenate([self._lagged(one, self.stretches) for one in rows])
        return columns

    def lag(self, name: str, column: int) -> float:
        """Return the lag of a column in seconds."""
        variant, place = divmod(column, len(self.stretches))
        first, last = self.stretches[place]
        half = 0.5 if variant < len(HALF_A_STEP) and HALF_A_STEP[variant] else 0.0
        return ((first + last - 1) / 2 + half) * self.response.step + self.candidates[name].age

    def _left(self, given: Sequence[str]) -> Floats:
        """Return the residuals after own past and given candidates (3 x samples): level, spread, robust level."""
        names = [_OWN_PAST, *given]
        level = self._without(self.level, names)
        size = np.abs(level)
        size -= size.mean()
        lags = [(lag, lag + 1) for lag in _OWN if lag <= self.rows // (_ROWS_PER_TERM * len(self.response.values))]
        own = self._lagged(size, lags).T.astype(np.float64)
        spread = self._without(size, names, own)
        return np.stack([self._centred(one) for one in (level, spread, self._robust(level, names))])

    def _robust(self, level: Floats, names: Sequence[str]) -> Floats:
        """Return the residual of a fit to the rows that are explained well, with the other rows clipped.

        A strong candidate that jumps leaves large errors at its jumps, by jitter alone; they must not hide a weak one
        at all other times.
        """
        design = np.hstack([self._design(name) for name in names])
        left, limit = level, 0.0
        for _ in range(_TRIMS):
            limit = _OUTLIER * float(np.median(np.abs(left))) + 1e-9
            good = np.abs(left) <= limit
            if good.sum() <= 2 * design.shape[1]:
                break
            some = design[good]
            products = some.T @ some
            products[np.diag_indices_from(products)] += _RIDGE * self.rows
            left = self.level - design @ np.linalg.solve(products, some.T @ self.level[good])
        return np.clip(left, -limit, limit)

    def _without(self, series: Floats, names: Sequence[str], own: Floats | None = None) -> Floats:
        """Return the residual of a series after some sets of columns, by normal equations whose products are cached."""
        blocks = [self._design(name) for name in names]
        rows = [np.hstack([self._product(one, other) for other in names]) for one in names]
        products, target = np.vstack(rows), np.concatenate([block.T @ series for block in blocks])
        if own is not None and own.shape[1]:
            across = np.vstack([block.T @ own for block in blocks])
            products = np.block([[products, across], [across.T, own.T @ own]])
            target = np.concatenate([target, own.T @ series])
            blocks.append(own)
        products[np.diag_indices_from(products)] += _RIDGE * self.rows
        weights = np.split(np.linalg.solve(products, target), np.cumsum([block.shape[1] for block in blocks])[:-1])
        left = series.copy()
        for block, part in zip(blocks, weights, strict=True):
            left -= block @ part
        return left

    def _product(self, one: str, other: str) -> Floats:
        if (one, other) not in self._products:
            found = self._design(one).T @ self._design(other)
            self._products[one, other], self._products[other, one] = found, found.T
        return self._products[one, other]

    def _centred(self, series: Floats) -> Floats:
        deviation = float(series.std()) or 1.0
        cut = np.clip(series / deviation, -5.0, 5.0)
        for low, high in self._parts():
            begin = low + min(self._longest, (high - low) // 8)
            cut[low:begin] = 0.0  # their past is unknown, and everything starts at once
            cut[begin:high] -= cut[begin:high].mean()
        return cut

    def _design(self, name: str) -> Floats:
        """Return the columns by which a candidate is removed: all, or with few rows those that explain most."""
        if name not in self._known:
            columns = np.ascontiguousarray(self.columns(name, changes=False).T, dtype=np.float64)
            most = max(2, self.rows // _ROWS_PER_TERM)
            if columns.shape[1] > most:
                columns = columns[:, fit_terms(self._without(self.level, [_OWN_PAST]), columns, most=most) or [0]]
            self._known[name] = columns
        return self._known[name]

    def shares(self, selected: Sequence[str], scores: Mapping[str, _Score]) -> dict[str, Share]:
        """Return the strengths of the selected candidates."""
        left = self._left([])
        cuts = -(-_GROUPS // len(self.response.values))
        stretches = [np.arange(high - low) * cuts // (high - low) for low, high in self._parts()]
        groups = np.concatenate([number * cuts + one for number, one in enumerate(stretches)])
        own = np.linalg.qr(self._design(_OWN_PAST))[0]
        designs = {name: self._design(name) - own @ (own.T @ self._design(name)) for name in selected}
        result: dict[str, Share] = {}
        for place, follows in enumerate(("level", "spread")):
            asked = [name for name in selected if scores[name].follows == follows]
            if asked:
                found = estimate(left[place], designs, selected=selected, asked=asked, groups=groups)
                result |= {one.name: one for one in found}
        return result


def _stretches(longest: int) -> list[tuple[int, int]]:
    """Return half-open stretches of lags from 0 to beyond the longest."""
    found = [(lag, lag + 1) for lag in range(min(longest, _EXACT))]
    first = len(found)
    while first < longest:
        last = max(first + 2, round(first * 1.25))
        found.append((first, last))
        first = last
    return found
