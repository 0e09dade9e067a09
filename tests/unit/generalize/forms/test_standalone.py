from __future__ import annotations

import ast
import inspect
import math
import sys

import numpy as np
import pytest

from riot_bus.generalize.forms import standalone
from riot_bus.generalize.forms.standalone import INTEGERS, div, larger, leg, near, nearest, quotient, single, smaller
from riot_bus.generalize.sampling import integer_range

ODD = [0.0, -0.0, 1.5, -2.0, math.inf, -math.inf, math.nan, 3, -7]


def test_it_needs_the_standard_library_alone() -> None:
    for node in ast.walk(ast.parse(inspect.getsource(standalone))):
        names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
        names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
        assert all(name.partition(".")[0] in sys.stdlib_module_names for name in names)


@pytest.mark.parametrize("a", ODD)
@pytest.mark.parametrize("b", ODD)
def test_arithmetic_is_that_of_ieee_754(a: float, b: float) -> None:
    with np.errstate(all="ignore"):
        assert np.array_equal(div(a, b), np.float64(a) / np.float64(b), equal_nan=True)
        assert np.array_equal(larger(a, b), np.maximum(float(a), float(b)), equal_nan=True)
        assert np.array_equal(smaller(a, b), np.minimum(float(a), float(b)), equal_nan=True)


def test_quotients_of_integers_are_exact() -> None:
    assert quotient(2**80 + 1, 2) == 2**79
    assert quotient(-7, 2) == -4
    assert quotient(7.0, 2) == 3.5
    assert math.isnan(quotient(1, 0))


def test_the_leg_of_a_triangle() -> None:
    assert leg(5, 3) == 4.0
    assert math.isnan(leg(3, 5))
    assert math.isnan(leg(math.inf, 5))


def test_types_have_the_ranges_that_they_have_elsewhere() -> None:
    assert {kind: integer_range(kind) for kind in INTEGERS} == INTEGERS


@pytest.mark.parametrize("kind", ["int8", "uint8", "float32", "float64"])
def test_what_is_near_fits_the_type(kind: str) -> None:
    for root in (0.0, 127.4, 255.0, -128.0, 3.4e38, 1e39, 5e-324):
        for value in near(root, kind, 1e3):
            if kind in INTEGERS:
                assert INTEGERS[kind][0] <= value <= INTEGERS[kind][1]
            else:
                assert kind == "float64" or single(value) == value
    assert 2.5 in list(near(2.5, kind, 0.0)) or kind in INTEGERS


def test_what_meets_no_term_stays_as_it_is() -> None:
    assert nearest([3], [lambda x: x > 5], [(0, lambda x: 5, 5)], ["int8"], [1.0]) == [3]
    assert nearest([9], [lambda x: x > 5], [(0, lambda x: 5, 5)], ["int8"], [1.0]) == [5]
    assert nearest([9], [lambda x: True], [(0, lambda x: 5, 5)], ["int8"], [1.0]) is None
