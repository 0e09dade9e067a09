"""Aspects of an internal series that may follow an external field: its level, its innovations, its spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from riot_bus.backchain.fir import Floats, fit_terms, fitted, memory_of

Effect = Literal["level", "change", "spread"]
"""Aspect of an internal field that follows an external one: its value, its innovations, or how much it varies."""

CHANNELS: tuple[Effect, ...] = ("level", "change", "spread", "level", "level")
"""The effect that each column of `residuals` shows."""

TERMS = 4  # a guess: for each field; `fit_terms` may stop earlier, this bounds its time
_LEAST_SPREAD = 0.25  # of the mean size: quiet samples weigh at most four times as much
_TRIMS = 6  # a guess: each fit without outliers shows which samples really are
_MEMORY = 0.99  # largest size of an autocorrelation: with 1, innovations of a drift would be noise alone
_OUTLIER = 6.0  # times the median size: four standard deviations of normal noise


def responses(pieces: Sequence[Floats], level: Floats | None = None) -> Floats:
    """Return level, innovation and spread (size of `level`, or of the series), centred per run (samples x 3)."""
    memory = memory_of(pieces, low=-_MEMORY, high=_MEMORY)
    rest = _cut(np.concatenate(pieces) if level is None else level, pieces)
    parts = []
    for one, left in zip(pieces, rest, strict=True):
        change = np.concatenate([one[:1] * 0.0, one[1:] - memory * one[:-1]])
        both = np.column_stack([one, change, np.abs(left)])
        parts.append(both - both.mean(axis=0))
    return np.concatenate(parts)


def residuals(
    pieces: Sequence[Floats], designs: Mapping[str, Floats], *, selected: Sequence[str]
) -> tuple[Floats, Floats]:
    """Return the responses, and their residuals after the selected fields (samples x 3, samples x 5).

    The fourth column is the level weighted by the inverse of its noise's covariance (first-order autocorrelation, and
    the spread that the selected fields explain): the score of generalised least squares, for weak effects in noise.
    The fifth is the residual of a fit to the well-explained samples, for weak effects beside a strong field that jumps.
    """
    raw = responses(pieces)
    spread = np.ones(len(raw))
    left = raw
    if selected:
        design = np.hstack([designs[name] for name in selected])
        most = TERMS * len(selected)
        level = raw[:, 0] - _explained(raw[:, 0], design, most)
        raw = responses(pieces, level)
        explained = [_explained(raw[:, at], design, most) for at in range(3)]
        left = raw - np.column_stack(explained)
        size = float(np.abs(level).mean())
        spread = np.maximum(size + explained[2], _LEAST_SPREAD * size) if size > 0 else spread
    even = _cut(left[:, 0] / spread, pieces)
    memory = memory_of(even, low=-_MEMORY, high=_MEMORY)
    parts = []
    for one, weight in zip(even, _cut(spread, pieces), strict=True):
        innovation = np.concatenate([one[:1], one[1:] - memory * one[:-1]])
        score = innovation - memory * np.concatenate([innovation[1:], innovation[:1] * 0.0])
        parts.append(score / weight - np.mean(score / weight))
    robust = left[:, 0]
    if selected:
        robust = _robust(raw[:, 0], design, most)
    return raw, np.column_stack([left, np.concatenate(parts), robust])


def _robust(response: Floats, design: Floats, most: int) -> Floats:
    """Return the residual of a fit to the well-explained samples, with the others clipped.

    A strong field that jumps leaves large errors at the samples around its jumps, by jitter alone; they must not hide
    a weak field in all other samples.
    """
    terms = fit_terms(response, design, most=most)
    if not terms:
        plain: Floats = response - response.mean()
        return plain
    chosen = np.column_stack([design[:, terms], np.ones(len(response))])
    good = np.ones(len(response), dtype=bool)
    left = response
    for _ in range(_TRIMS):
        left = response - chosen @ np.linalg.lstsq(chosen[good], response[good], rcond=None)[0]
        limit = _OUTLIER * float(np.median(np.abs(left))) + 1e-12
        good = np.abs(left) <= limit
        if good.sum() <= 2 * chosen.shape[1]:
            break
    cut: Floats = np.clip(left, -limit, limit)
    cut -= cut.mean()
    return cut


def _explained(response: Floats, design: Floats, most: int) -> Floats:
    return fitted(response, design[:, fit_terms(response, design, most=most)])


def _cut(stacked: Floats, pieces: Sequence[Floats]) -> list[Floats]:
    return np.split(stacked, np.cumsum([len(one) for one in pieces])[:-1])
