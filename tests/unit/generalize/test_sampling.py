import math
import random

import pytest

from riot_bus.generalize.sampling import TYPES, Sampler, Variable, fit, interesting
from riot_bus.vocabulary.trial import Scalar


@pytest.mark.parametrize("type_", ["int64", "uint64", "float32", "float64"])
def test_an_integer_that_a_type_cannot_hold_does_not_fit(type_: str) -> None:
    assert fit(10**400, type_) is None
    assert fit(-(10**400), type_) is None


def test_a_value_fits_as_its_type_holds_it() -> None:
    assert fit(2.9, "int8") == 2
    assert fit(True, "uint8") == 1
    assert fit(0.1, "float32") == pytest.approx(0.1, abs=1e-8)
    assert fit(0.1, "float32") != 0.1
    assert fit(math.inf, "float32") == math.inf
    assert fit("a", "string") == "a"
    assert fit("a", "bytes") is None
    assert fit(1, "bool") is None


FAILING: dict[str, Scalar] = {"bool": True, "string": "a", "bytes": b"a", "float32": 1.5, "float64": 1.5}


@pytest.mark.parametrize("type_", TYPES)
def test_every_draw_is_a_value_that_the_type_holds(type_: str) -> None:
    failing = FAILING.get(type_, 3)
    variable = Variable("v", type_, failing, (), (failing,), (failing,))
    chance, sampler = random.Random(1), Sampler([variable])
    drawn = [sampler.assignment(chance)["v"] for _ in range(300)]
    assert {type(value) for value in drawn} == {type(failing)}
    assert all(repr(fit(value, type_)) == repr(value) for value in drawn)
    assert any(value != failing for value in drawn)


def test_known_values_are_the_failing_one_edges_and_a_few_nominal_ones() -> None:
    known = interesting(Variable("v", "int16", 7, (8,), tuple(range(1000, 2000)), (9,)))
    assert {7, 8, 9, 0, 1, -1, -(2**15), 2**15 - 1, 1000, 1999} <= set(known)
    assert len(known) < 25
    assert interesting(Variable("v", "bytes", b"x", (b"",), (b"b", b"a"))) == [b"x", b"", b"a", b"b"]
    assert interesting(Variable("v", "bool", True)) == [True, False]


def test_nominal_draws_lie_between_observed_values_and_keep_those_that_are_no_numbers() -> None:
    observed = (10.0, 20.0, math.nan, math.inf)
    variable = Variable("v", "float64", 99.0, (), observed)
    sampler, chance = Sampler([variable]), random.Random(2)
    sampler.known["v"] = [99.0]
    drawn = [sampler.value(variable, chance) for _ in range(2000)]
    between = [value for value in drawn if isinstance(value, float) and 10 < value < 20]
    assert len({round(value, 1) for value in between}) > 20
    assert math.inf in drawn
    assert any(value != value for value in drawn)
