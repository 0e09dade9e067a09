"""Conformance tests for methods of `riot activate --search`, for their authors to inherit.

    class TestMine(SearchConformance):
        method = MyMethod

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pytest

from riot_bus.backchain.proposers import History, proposers
from riot_bus_testkit.plugin import PluginConformance

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from riot_bus.backchain.fir import Floats
    from riot_bus.backchain.proposers import Proposer, SearchMethod


class SearchConformance(PluginConformance):
    """Tests of a search method: it stays in bounds, is deterministic for equal seeds, and approaches the optimum.

    Before it is asked, the history contains the nominal vector and four probes along each axis, as in a real search.

    Attributes:
        method: Factory of the method: the class, or a `staticmethod` of a function.
        rounds: Number of answers that suffice for an easy function.
    """

    method: ClassVar[SearchMethod]
    rounds: ClassVar[int] = 60  # enough for the shipped simplex; others set their own

    @pytest.mark.parametrize("size", [1, 3])
    def test_it_stays_in_bounds(self, size: int) -> None:
        """Vectors have the shape (n,), are finite and within [0, 1], even if the optimum is in a corner."""
        for vector in self._vectors(size, lambda vector: float(vector.sum())):
            assert np.shape(vector) == (size,)
            assert ((vector >= 0) & (vector <= 1)).all(), vector

    @pytest.mark.parametrize("size", [1, 3])
    def test_it_gives_as_many_as_are_asked_for(self, size: int) -> None:
        """There is a next vector whenever all are answered, and later vectors do not modify earlier ones."""
        pairs = [(vector, vector.copy()) for vector in self._vectors(size, _bowl)]
        assert len(pairs) == self.rounds
        assert all(np.array_equal(vector, then) for vector, then in pairs)

    def usual(self) -> list[list[float]]:
        """Return the vectors that it proposes on a bowl of three dimensions."""
        return [vector.tolist() for vector in self._vectors(3, _bowl, seed=7)]

    def strange(self) -> list[str]:
        """Return the answers after which it gives fewer vectors, or one out of bounds."""
        return [str(answer) for answer in (math.nan, math.inf, -math.inf, 1e300, 0.0) if not self._survives(answer)]

    @pytest.mark.parametrize("size", [1, 3])
    def test_it_gets_nearer_than_its_start(self, size: int) -> None:
        """On a quadratic bowl, it finds a value below three quarters of that at the nominal vector."""
        found = [_bowl(vector) for vector in self._vectors(size, _bowl)]
        assert min(found) < 0.75 * _bowl(np.full(size, 0.5))

    def test_several_may_be_out_at_once(self) -> None:
        """Asked again before an answer, it gives another vector or None; answers may arrive in any order."""
        history, (method,) = self._begun(2, _bowl, 3)
        for _ in range(self.rounds // 4):
            out = [vector for vector in (method.ask() for _ in range(4)) if vector is not None]
            assert out
            for vector in reversed(out):
                history.add(vector, _bowl(vector))
                method.tell(vector, _bowl(vector))

    def _survives(self, answer: float) -> bool:
        vectors = list(self._vectors(2, lambda vector: answer))
        return len(vectors) == self.rounds and all(((vector >= 0) & (vector <= 1)).all() for vector in vectors)

    def _vectors(self, size: int, value: Callable[[Floats], float], *, seed: int = 0) -> Iterator[Floats]:
        """Yield the vectors that the method proposes if each is answered at once."""
        if size < getattr(type(self).method, "least_size", 1):
            pytest.skip(f"it needs more than {size} dimensions")
        history, (method,) = self._begun(size, value, seed)
        for _ in range(self.rounds):
            vector = method.ask()
            assert vector is not None, "it waits though all answers are there"
            yield vector
            answer = value(vector)
            if math.isfinite(answer):  # the history contains only finite values
                history.add(vector, answer)
            method.tell(vector, answer)

    def _begun(self, size: int, value: Callable[[Floats], float], seed: int) -> tuple[History, list[Proposer]]:
        history, nominal = History(), np.full(size, 0.5)
        for vector in nominal + np.vstack(
            [np.zeros(size), *(reach * np.eye(size) for reach in (-0.2, 0.2, -0.35, 0.35))]
        ):
            answer = value(vector)
            history.add(vector, answer if math.isfinite(answer) else 1.0)
        return history, proposers([type(self).method], history, nominal, [seed])


def _bowl(vector: Floats) -> float:
    """Return the squared distance to a vector that is not near any probe."""
    return float(((vector - 0.83) ** 2).sum())
