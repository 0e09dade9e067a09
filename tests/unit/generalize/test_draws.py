from __future__ import annotations

import random

from riot_bus.generalize.draws import Draws
from riot_bus.generalize.questions import Questions
from riot_bus.generalize.sampling import Variable

X = Variable("x", "int8", 100, nominal=(1, 2))
Y = Variable("y", "bool", failing=True, passing=(False,))


def test_new_questions_only():
    asking = Questions([X, Y], lambda some: [True] * len(some), None, lambda *_: None, budget=100, parallelism=1)
    draws = Draws(asking, random.Random(1))
    assert all(draws.nominal()["x"] in (1, 2) and draws.nominal()["y"] is False for _ in range(5))
    base = {"x": 100, "y": True}
    asking.ask([base], "start")
    asking.ask([draws.alone(base), draws.alone(base)], "start")
    assert all(sum(one[name] != base[name] for name in base) <= 1 for one in asking.table.assignments)
    pool = draws.pool()
    assert pool
    assert not any(map(asking.known, pool))
    assert not asking.known(draws.explore())
