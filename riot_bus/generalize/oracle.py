"""A cache and counter in front of a batch oracle, and the weighted search for a flip of its answers."""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Callable, Hashable, Mapping, Sequence
from itertools import accumulate
from typing import Generic, TypeVar

from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask, Progress, Scalar

__all__ = ["Oracle", "assignment_key", "find_flip", "same_scalar", "scalar_key"]

QuestionT = TypeVar("QuestionT")


def scalar_key(value: Scalar) -> Hashable:
    """Return a key equal exactly for bit-identical values (NaN equals itself, -0.0 is not 0.0, True is not 1)."""
    if isinstance(value, float):
        return ("float", struct.pack("<d", value))
    return (type(value).__name__, value)


def same_scalar(left: Scalar, right: Scalar) -> bool:
    """Return whether two values are bit-identical."""
    return scalar_key(left) == scalar_key(right)


def assignment_key(assignment: Mapping[str, Scalar]) -> Hashable:
    """Return a key of one value per field, independent of the order of the fields."""
    return tuple((name, scalar_key(assignment[name])) for name in sorted(assignment))


class Oracle(Generic[QuestionT]):
    """Asks each question at most once, and counts.

    Args:
        ask: The batch oracle.
        key: What makes two questions the same.
        progress: Told after every batch.
    """

    def __init__(
        self,
        ask: Ask[QuestionT],
        *,
        key: Callable[[QuestionT], Hashable],
        progress: Progress | None = None,
    ) -> None:
        self._ask = ask
        self._key = key
        self._progress = progress
        self._answers: dict[Hashable, bool] = {}
        self.expected: int | None = None

    @property
    def trials(self) -> int:
        """Number of distinct questions asked so far."""
        return len(self._answers)

    def known(self, question: QuestionT) -> bool | None:
        """Return the answer if the question was asked before, else None."""
        return self._answers.get(self._key(question))

    def ask(self, questions: Sequence[QuestionT], doing: str) -> list[bool]:
        """Return one answer per question; only new ones go to the system, in one batch.

        Args:
            questions: Any number of questions, also repeated ones.
            doing: What is going on, for `progress`.

        Raises:
            InconclusiveError: If the oracle does not give one answer per question.
        """
        keys = [self._key(question) for question in questions]
        new = {key: question for key, question in zip(keys, questions, strict=True) if key not in self._answers}
        if new:
            answers = self._ask(list(new.values()))
            if len(answers) != len(new):
                raise InconclusiveError(f"{len(new)} trials were asked for, but {len(answers)} outcomes came back")
            self._answers.update(zip(new, (bool(answer) for answer in answers), strict=True))
            if self._progress is not None:
                self._progress(self.trials, self.expected, doing)
        return [self._answers[key] for key in keys]


def find_flip(
    masses: Sequence[float], probe: Callable[[Sequence[int]], Sequence[bool]], *, low: int, parallelism: int = 1
) -> int:
    """Return a position where `probe` is True and the position before it is not, by weighted bisection.

    `probe` is known (or defined) to be False at `low` and True at `low + len(masses)`. Of several flips one is found.

    Args:
        masses: Prior weight that the flip is at position `low + 1 + i`.
        probe: Answers a batch of positions.
        low: Known False.
        parallelism: Positions per batch; k positions divide the mass into k + 1 parts.
    """
    total = list(accumulate((max(float(mass), 0.0) + 1e-12 for mass in masses), initial=0.0))
    first, last = 0, len(masses)
    while last - first > 1:
        mass = total[last] - total[first]
        cuts = set()
        for part in range(1, parallelism + 1):
            goal = total[first] + mass * part / (parallelism + 1)
            at = bisect_left(total, goal, first + 1, last)
            if at - 1 > first and goal - total[at - 1] < total[min(at, last)] - goal:
                at -= 1
            cuts.add(min(max(at, first + 1), last - 1))
        ordered = sorted(cuts)
        answers = probe([low + cut for cut in ordered])
        hit = next((index for index, answer in enumerate(answers) if answer), len(ordered))
        if hit < len(ordered):
            last = ordered[hit]
        if hit > 0:
            first = ordered[hit - 1]
    return low + last
