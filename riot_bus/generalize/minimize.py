"""Minimisation: the few messages of a failing log that are needed for the failure (RIOT II-B a).

Weighted search for the shortest failing prefix: it ends with a needed message. Keep that one, cut what comes behind,
repeat with the kept ones in front until they alone fail. About log2(n) trials per needed message, where delta debugging
takes two to three times as many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from riot_bus.generalize.oracle import Oracle, find_flip
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask, Progress

__all__ = ["Minimal", "minimize"]

SAME_GROUP = 8.0
"""How much likelier a message is needed when another one of its group (topic) is."""


@dataclass(frozen=True, slots=True)
class Minimal:
    """The result of a minimisation.

    `kept` are indices into the log, ascending. `one_minimal` says that removing any one of them was tried and stops the
    failure.
    """

    kept: tuple[int, ...]
    trials: int
    one_minimal: bool

    @property
    def needs_messages(self) -> bool:
        """Whether the failure depends on messages at all (False: it happens with an empty log)."""
        return bool(self.kept)


def minimize(
    n: int,
    ask: Ask[tuple[int, ...]],
    *,
    weights: Sequence[float] | None = None,
    groups: Sequence[str] | None = None,
    parallelism: int = 1,
    progress: Progress | None = None,
) -> Minimal:
    """Find a 1-minimal failing part of a log.

    Args:
        n: Number of messages; they are called 0..n-1 in log order.
        ask: Each question is an ascending tuple of kept messages; True = still fails with the same signature.
        weights: Prior weight of each message to be needed (injected ones high, then those close before the failure).
        groups: Topic of each message; needed messages often share one.
        parallelism: Questions worth asking in one batch.
        progress: Told after every batch.

    Returns:
        The kept messages. They fail; without any one of them they do not.

    Raises:
        InconclusiveError: If the whole log does not fail.
        ValueError: If `weights` or `groups` do not have `n` entries, or a weight is negative.
    """
    if n < 0 or any(given is not None and len(given) != n for given in (weights, groups)):
        raise ValueError(f"weights and groups need one entry for each of the {n} messages")
    prior = [1.0] * n if weights is None else [float(weight) for weight in weights]
    if not all(weight >= 0 for weight in prior):
        raise ValueError("weights must not be negative")
    oracle: Oracle[tuple[int, ...]] = Oracle(ask, key=lambda question: question, progress=progress)
    whole, empty = oracle.ask([tuple(range(n)), ()], "checking the whole and the empty log")
    if not whole:
        raise InconclusiveError(
            f"the whole log ({n} messages) does not fail with this signature, so there is nothing to minimise",
            hint="replay it several times; if it fails only sometimes, raise the number of repetitions",
        )
    if empty:
        return Minimal((), oracle.trials, one_minimal=True)
    kept = _search(oracle, prior, groups, parallelism)
    kept = _without_removable(oracle, kept, parallelism)
    return Minimal(tuple(sorted(kept)), oracle.trials, one_minimal=True)


def _search(
    oracle: Oracle[tuple[int, ...]], prior: list[float], groups: Sequence[str] | None, parallelism: int
) -> list[int]:
    """Return a failing set by repeated search for the shortest failing prefix; latest found last."""
    kept: list[int] = []
    prior = list(prior)
    order = sorted(range(len(prior)), key=lambda item: (-prior[item], item))
    while order:
        doing = f"looking for needed message {len(kept) + 1}"

        def probe(lengths: Sequence[int], doing: str = doing, order: list[int] = order) -> list[bool]:
            return oracle.ask([tuple(sorted(kept + order[:length])) for length in lengths], doing)

        masses = [prior[item] for item in order]
        if kept:
            # The position "nothing else is needed" gets half of the mass: most failures need one or two messages.
            length = find_flip([sum(masses) or 1.0, *masses], probe, low=-1, parallelism=parallelism)
            if length == 0:
                break
        else:
            length = find_flip(masses, probe, low=0, parallelism=parallelism)
        found = order[length - 1]
        kept.append(found)
        order = order[: length - 1]
        if groups is not None and sum(groups[item] == groups[found] for item in kept) == 1:
            for item in order:
                if groups[item] == groups[found]:
                    prior[item] *= SAME_GROUP
            order.sort(key=lambda item: (-prior[item], item))
    return kept


def _without_removable(oracle: Oracle[tuple[int, ...]], kept: list[int], parallelism: int) -> list[int]:
    """Return a 1-minimal part of a failing set: the proof for a monotone system, the repair for others."""
    kept = sorted(kept)
    start = 0
    while start < len(kept):
        batch = range(start, min(start + parallelism, len(kept)))
        questions = [tuple(kept[:index] + kept[index + 1 :]) for index in batch]
        answers = oracle.ask(questions, "checking that every kept message is needed")
        removable = next((index for index, answer in zip(batch, answers, strict=True) if answer), None)
        if removable is None:
            start += parallelism
        else:
            # What comes before was needed in the larger set; in a system that is not monotone that may have changed.
            del kept[removable]
            start = 0
    return kept
