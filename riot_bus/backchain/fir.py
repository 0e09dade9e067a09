"""Finite impulse response designs: an internal series explained by lagged, value-held external signals (RIOT II-C).

All sums over samples are linear in the redrawn signal values, so a redraw never builds its design: correlations are one
matrix product of the drawn values with a table that the residuals fill (`correlate_draws`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from riot_bus.vocabulary.injection import Signal

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_TINY = 1e-12  # avoids divisions by 0; sums over samples of variance 1 are far larger
_CLIP = 5.0  # normal noise exceeds 5 standard deviations once in 1.7 million samples


@dataclass(frozen=True, slots=True)
class Grid:
    """The lags at which an input is evaluated.

    Attributes:
        seconds: Lags in seconds back from each output sample.
        messages: Further lags in input messages, for inputs that are much faster or slower than the output.
    """

    seconds: tuple[float, ...]
    messages: tuple[int, ...] = ()

    def indices(self, input_times: Floats, output_times: Floats) -> Ints:
        """Return, per output sample and lag, the index of the latest input message at that time (n x lags).

        Before the first message, it is the index of the first one.
        """
        late = output_times[:, None] - np.asarray(self.seconds)[None, :]
        found = np.searchsorted(input_times, late, side="right") - 1
        if self.messages:
            found = np.hstack([found, found[:, :1] - np.asarray(self.messages)[None, :]])
        index: Ints = np.clip(found, 0, len(input_times) - 1).astype(np.int64)
        return index

    def lag(self, column: int, *, input_step: float) -> float:
        """Return the lag of a column in seconds; `input_step` is the time between input messages."""
        if column < len(self.seconds):
            return self.seconds[column]
        return self.messages[column - len(self.seconds)] * input_step


def lag_grid(output_step: float, input_step: float, *, lags: int) -> Grid:
    """Return the lags for a pair of sample intervals (seconds).

    Lags are counted in output samples. If the input is faster, further lags in input messages fill the first output
    interval; if it is slower, they reach back over `lags` messages.
    """
    seconds = tuple(lag * output_step for lag in range(lags))
    ratio = output_step / input_step if input_step > 0 else 1.0
    if 2 / 3 <= ratio <= 1.5:
        return Grid(seconds)
    spacing = max(1, round(ratio / lags))
    return Grid(seconds, tuple(spacing * lag for lag in range(1, lags)))


@dataclass(frozen=True, slots=True)
class RunColumns:
    """One external field in one run, seen at the output's samples.

    Attributes:
        index: Input message per sample and lag (n x lags).
        values: Delivered values, in units of the signal's amplitude around its centre.
        first: The topic's index of the first message in `values`.
    """

    rows: slice
    index: Ints
    values: Floats
    signal: Signal
    first: int

    def blocks(self) -> Ints:
        """Return for each message the number of the held value it belongs to, from 0."""
        numbers = (self.first + np.arange(len(self.values))) // max(self.signal.hold, 1)
        block: Ints = (numbers - numbers[0]).astype(np.int64)
        return block

    def redraw(self, draws: int, rng: np.random.Generator) -> Floats:
        """Return held values of the same signal with other seeds (draws x blocks), in units of the amplitude."""
        drawn = rng.uniform(-1.0, 1.0, size=(draws, int(self.blocks()[-1]) + 1))
        signal = self.signal
        if signal.integer and signal.amplitude:
            drawn = (np.round(signal.center + signal.amplitude * drawn) - signal.center) / signal.amplitude
        return drawn


@dataclass(frozen=True, slots=True)
class LagColumns:
    """One external field over all runs: linear columns for every lag, then the centred squares.

    Runs in which the field was not driven have zero columns.
    """

    grid: Grid
    input_step: float
    runs: tuple[RunColumns, ...]
    samples: int

    @property
    def lags(self) -> int:
        """Number of lags."""
        return len(self.grid.seconds) + len(self.grid.messages)

    def lag(self, column: int) -> float:
        """Return the lag in seconds of a column of `design`."""
        return self.grid.lag(column % self.lags, input_step=self.input_step)

    def design(self) -> Floats:
        """Return the observed columns, centred per run (samples x 2 lags)."""
        matrix = np.zeros((self.samples, 2 * self.lags))
        for run in self.runs:
            held = run.values[run.index]
            both = np.hstack([held, held**2])
            matrix[run.rows] = both - both.mean(axis=0)
        return matrix

    def correlate(self, responses: Floats) -> Floats:
        """Return the squared correlations of the observed columns with responses (1 x 2 lags x responses)."""
        design = self.design()
        return _squared(design.T @ responses, (design**2).sum(axis=0), responses)[None]

    def correlate_draws(self, responses: Floats, *, draws: int, seed: Sequence[int]) -> Floats:
        """Return the same for redrawn signals (draws x 2 lags x responses); equal seeds give equal redraws."""
        lags, channels = self.lags, responses.shape[1]
        products = np.zeros((draws, 2 * lags, channels))
        norms = np.zeros((draws, 2 * lags))
        for number, run in enumerate(self.runs):
            drawn = run.redraw(draws, np.random.default_rng([*seed, number]))
            block = run.blocks()[run.index]
            blocks = drawn.shape[1]
            flat = (block * lags + np.arange(lags)).ravel()
            counts = np.bincount(flat, minlength=blocks * lags).reshape(blocks, lags)
            weights = np.empty((blocks, lags, channels))
            for channel in range(channels):
                spread = np.repeat(responses[run.rows, channel], lags)
                weights[..., channel] = np.bincount(flat, spread, minlength=blocks * lags).reshape(blocks, lags)
            table = weights.reshape(blocks, lags * channels)
            square = drawn**2
            for part, values in ((slice(0, lags), drawn), (slice(lags, None), square)):
                products[:, part] += (values @ table).reshape(draws, lags, channels)
                norms[:, part] += (values**2) @ counts - (values @ counts) ** 2 / len(run.index)
        return _squared(products, norms, responses)


def _squared(products: Floats, norms: Floats, responses: Floats) -> Floats:
    scale = np.maximum(norms, _TINY)[..., None] * np.maximum((responses**2).sum(axis=0), _TINY)
    result: Floats = np.where(norms[..., None] > _TINY, products**2 / scale, 0.0)
    return result


def standardise(values: Floats) -> Floats:
    """Return one run's samples with mean 0 and variance about 1, outliers clipped; zeros when it is constant."""
    finite = np.isfinite(values)
    if finite.sum() < 3:
        return np.zeros_like(values)
    # Scaled before anything else, since sums of large values overflow.
    known = values[finite]
    known = known / (float(np.abs(known).max()) or 1.0)
    result = known
    if len(known) < len(values):
        result = np.full(len(values), np.median(known))
        result[finite] = known
    # Two passes: the second one measures without the outliers that the first one clipped.
    for _ in range(2):
        result = result - result.mean()
        deviation = float(result.std())
        if deviation <= 1e-9:
            return np.zeros_like(result)
        result = np.clip(result / deviation, -_CLIP, _CLIP)
    centred: Floats = result - result.mean()
    return centred


def fitted(response: Floats, design: Floats) -> Floats:
    """Return the least-squares fit of a response by all columns of a design (samples x columns); 0 without columns."""
    if not design.shape[1]:
        return np.zeros_like(response)
    found: Floats = design @ np.linalg.lstsq(design, response, rcond=None)[0]
    return found


def memory_of(pieces: Sequence[Floats], *, low: float, high: float) -> float:
    """Return the share of a series' value that the next one keeps (first-order autoregression), within limits."""
    products = sum(float(one[:-1] @ one[1:]) for one in pieces)
    squares = sum(float(one[:-1] @ one[:-1]) for one in pieces)
    return float(np.clip(products / squares, low, high)) if squares > 0 else 0.0


def fit_terms(response: Floats, design: Floats, *, most: int) -> list[int]:
    """Return the columns that explain a response, chosen one at a time until BIC says stop (at most `most`)."""
    samples = len(response)
    norms = np.sqrt((design**2).sum(axis=0))
    usable = norms > 1e-9
    residual = response
    error = float(response @ response)
    chosen: list[int] = []
    # Choosing the best of many columns costs for their number as well as for one parameter.
    price = np.log(max(samples, 2)) + 2 * np.log(max(int(usable.sum()), 1))
    while len(chosen) < min(most, samples // 4) and error > _TINY * samples:
        scores = np.where(usable, np.abs(design.T @ residual) / np.maximum(norms, 1e-9), 0.0)
        scores[chosen] = 0.0
        best = int(scores.argmax())
        if scores[best] <= 0.0:
            break
        trial = [*chosen, best]
        weights = np.linalg.lstsq(design[:, trial], response, rcond=None)[0]
        candidate = response - design[:, trial] @ weights
        left = float(candidate @ candidate)
        if samples * np.log(max(error, _TINY) / max(left, _TINY)) < price:
            break
        chosen, residual, error = trial, candidate, left
    return chosen
