"""Estimates the strength of an edge: its share of the variance, with a jackknife interval over runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from riot_bus.backchain.fir import Floats, Ints, fit_terms, fitted
from riot_bus.backchain.responses import TERMS
from riot_bus.vocabulary.errors import needs_extra

_FEWEST_GROUPS = 4  # Student's t: 3.2 standard errors with four groups, 4.3 with three, 12.7 with two


@dataclass(frozen=True, slots=True)
class Share:
    """Share of a response's variance that one field explains.

    Attributes:
        strength: The share, 0 to 1, corrected for the number of terms.
        low: Lower end of the 95 % jackknife interval.
        high: Upper end of that interval.
        column: Column of the field's design with the strongest effect.
    """

    name: str
    strength: float
    low: float
    high: float
    column: int


def estimate(
    response: Floats, designs: Mapping[str, Floats], *, selected: Sequence[str], asked: Sequence[str], groups: Ints
) -> list[Share]:
    """Return the share of each asked field, given the selected ones.

    The response is centred per run; what `selected` fields explain is not credited to others. `groups` has the run of
    each sample; with fewer than four runs each is cut into blocks for the jackknife.
    """
    groups = _blocks(groups)
    terms: list[tuple[str, int]] = []
    if selected:
        owners = [(name, column) for name in selected for column in range(designs[name].shape[1])]
        together = np.hstack([designs[name] for name in selected])
        terms = [owners[at] for at in fit_terms(response, together, most=TERMS * len(selected))]
    shares = []
    for name in asked:
        others = [term for term in terms if term[0] != name]
        without = _matrix(designs, others, len(response))
        column = _best(response - fitted(response, without), designs[name])
        own = [term for term in terms if term[0] == name] or [(name, column)]
        both = np.hstack([without, _matrix(designs, own, len(response))])
        share = _share(response, without, both)
        low, high = _jackknife(response, without, both, groups)
        shares.append(Share(name, share, min(low, share), max(high, share), column))
    return shares


def _matrix(designs: Mapping[str, Floats], terms: Sequence[tuple[str, int]], samples: int) -> Floats:
    if not terms:
        return np.zeros((samples, 0))
    return np.column_stack([designs[name][:, column] for name, column in terms])


def _best(response: Floats, design: Floats) -> int:
    norms = np.sqrt((design**2).sum(axis=0))
    return int(np.where(norms > 1e-9, np.abs(design.T @ response) / np.maximum(norms, 1e-9), 0.0).argmax())


def _share(response: Floats, without: Floats, both: Floats) -> float:
    total = float(response @ response)
    samples = len(response)
    if total <= 0 or samples <= both.shape[1] + 1:
        return 0.0
    small, large = (float(((response - fitted(response, design)) ** 2).sum()) for design in (both, without))
    noise = small / (samples - both.shape[1])
    return float(np.clip((large - small - noise * (both.shape[1] - without.shape[1])) / total, 0.0, 1.0))


def _jackknife(response: Floats, without: Floats, both: Floats, groups: Ints) -> tuple[float, float]:
    labels = np.unique(groups)
    shares = []
    for label in labels:
        keep = groups != label
        shares.append(_share(response[keep], without[keep], both[keep]))
    count = len(labels)
    center = float(np.mean(shares))
    error = float(np.sqrt((count - 1) / count * np.sum((np.asarray(shares) - center) ** 2)))
    reach = student_reach(count - 1) * error
    return max(0.0, center - reach), min(1.0, center + reach)


def _blocks(groups: Ints) -> Ints:
    runs = len(np.unique(groups))
    if runs >= _FEWEST_GROUPS:
        return groups
    pieces = -(-_FEWEST_GROUPS // runs)
    result = np.empty_like(groups)
    for run in np.unique(groups):
        rows = np.flatnonzero(groups == run)
        result[rows] = run * pieces + np.arange(len(rows)) * pieces // len(rows)
    return result


def student_reach(freedom: int, *, confidence: float = 0.95) -> float:
    """Return the half width of an interval in standard errors (Student's t).

    Raises:
        MissingExtraError: scipy is not installed.
    """
    with needs_extra("scipy", "analysis"):
        from scipy.special import stdtrit
    return float(stdtrit(freedom, (1 + confidence) / 2))
