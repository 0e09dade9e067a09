import math
import sys
from operator import ge, gt, le, lt

import numpy as np
import pytest

from riot_bus.generalize.expressions import numeric
from riot_bus.generalize.features import FEATURE_KINDS, Feature, features_of
from riot_bus.generalize.literals import boundary_distance
from riot_bus.generalize.numbers import between, number_bits, number_text, simplest, step
from riot_bus.generalize.table import Candidate, concrete
from riot_bus.vocabulary.errors import ConfigError

MIN64, MAX64 = -(2**63), 2**63 - 1
LARGEST = sys.float_info.max


def test_products_of_64_bit_integers_do_not_wrap() -> None:
    columns = {"x": np.array([MAX64, MIN64, 3]), "y": np.array([MAX64, MIN64, -4])}
    values = Feature("mul", ("x", "y")).values(columns)
    assert values is not None
    assert values.tolist() == [MAX64**2, MIN64**2, -12]


def test_sums_and_sizes_of_64_bit_integers_do_not_wrap() -> None:
    columns = {"x": np.array([MAX64, MIN64]), "y": np.array([2**64 - 1, 5], dtype=np.uint64)}
    expected = {
        "add": [MAX64 + 2**64 - 1, MIN64 + 5],
        "sub": [MAX64 - 2**64 + 1, MIN64 - 5],
        "maxabs": [2**64 - 1, 2**63],
        "minabs": [MAX64, 5],
    }
    for kind, values in expected.items():
        found = Feature(kind, ("x", "y")).values(columns)
        assert found is not None
        assert found.tolist() == values
    size = Feature("abs", ("x",)).values(columns)
    assert size is not None
    assert size.tolist() == [MAX64, 2**63]


def test_unsigned_sums_wrap_like_the_machine() -> None:
    columns = {"x": np.array([2**32 - 1, 5], dtype=np.uint32), "y": np.array([2, 6], dtype=np.uint32)}
    values = Feature("wrap32", ("x", "y")).values(columns)
    assert values is not None
    assert values.tolist() == [1, 11]


def test_floats_overflow_and_divide_by_zero_without_warnings() -> None:
    columns = {"x": np.array([1e300, 1.0, 0.0, math.nan]), "y": np.array([1e300, 0.0, 0.0, 1.0])}
    product = Feature("mul", ("x", "y")).values(columns)
    quotient = Feature("div", ("x", "y")).values(columns)
    assert product is not None
    assert quotient is not None
    assert product[0] == math.inf
    assert quotient[1] == math.inf
    assert math.isnan(quotient[2])


def test_flags() -> None:
    columns = {"x": np.array([math.nan, math.inf, 1.0]), "n": np.array([1, 2, 3])}
    assert Feature("nan", ("x",)).values(columns).tolist() == [True, False, False]  # type: ignore[union-attr]
    assert Feature("nonfinite", ("x",)).values(columns).tolist() == [True, True, False]  # type: ignore[union-attr]
    assert Feature("nan", ("n",)).values(columns).tolist() == [False] * 3  # type: ignore[union-attr]


def test_strings_are_not_numbers() -> None:
    assert numeric(np.array(["a"], dtype=object)) is None
    assert Feature("mul", ("a", "b")).values({"a": np.array(["a"]), "b": np.array([1])}) is None
    assert numeric(np.array([2**70, 1], dtype=object)).tolist() == [2**70, 1]  # type: ignore[union-attr]


def test_a_column_of_mixed_numbers_is_as_exact_as_they_allow() -> None:
    mixed = numeric(np.array([1, 2.5, True], dtype=object))
    assert mixed is not None
    assert mixed.tolist() == [1.0, 2.5, 1.0]
    whole = numeric(np.array([1, True, -(2**63)], dtype=object))
    assert whole is not None
    assert whole.dtype == np.int64
    assert numeric(np.array([None, 1], dtype=object)) is None
    assert numeric(np.array([1 + 2j])) is None


def test_bad_features_are_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean"):
        Feature("hypo", ("x", "y"))
    with pytest.raises(ConfigError, match="takes 2"):
        Feature("mul", ("x",))
    with pytest.raises(ConfigError, match="column"):
        Feature("raw", ("x",)).values({"y": np.array([1])})


def test_features_of_types() -> None:
    found = features_of({"m": "string", "n": "uint32", "k": "uint32", "f": "float64", "ok": "bool"})
    assert Feature("raw", ("m",)) in found
    assert Feature("wrap32", ("n", "k")) in found
    assert Feature("nan", ("f",)) in found
    assert Feature("abs", ("n",)) not in found
    assert {feature.kind for feature in found if "m" in feature.args} == {
        *("raw", "len", "bytes", "ascii", "printable", "digits")
    }
    assert not any("ok" in feature.args for feature in found if feature.kind != "raw")
    assert {feature.kind for feature in found} <= set(FEATURE_KINDS)


@pytest.mark.parametrize(
    ("low", "high", "value"),
    [
        (-5, 3, 0),
        (4194000, 4194310, 4194304),
        (2**63 + 11, 2**63 + 12, 2**63 + 11),
        (5e-324, 1e-323, 5e-324),
        (9.0, 11.0, 10.0),
        (4, 5, 4),
        (300, 60000, 1024),
        (999999, 1000000, 1000000),
        (-2147483700, -2147483640, -2147483648),
        (3.2, 3.9, 3.5),
        (0.9999, 1.0001, 1.0),
        (17, 17, 17),
        (5.0, math.inf, 8.0),
        (math.inf, math.inf, math.inf),
        (-math.inf, -math.inf, -math.inf),
    ],
)
def test_simplest(low: float, high: float, value: float) -> None:
    found = simplest(low, high)
    assert low <= found <= high
    assert number_bits(found) <= number_bits(value)
    assert isinstance(found, type(value))


def test_weights_of_one_are_free() -> None:
    plain, weighted = (Feature("linear", ("a", "b"), (1, weight)).cost for weight in (-1, 3))
    assert plain == Feature("linear", ("a", "b"), (1, 1)).cost == weighted - number_bits(3)


def test_simple_numbers_are_short() -> None:
    assert number_bits(0) < number_bits(1) < number_bits(10**6) < number_bits(1234567)
    assert number_bits(2**31) < number_bits(2**31 - 1) < number_bits(2147483001)
    assert number_text(1e6) == "1000000"
    assert number_text(1e12) == "1000000000000.0"
    assert number_text(50.0) == "50"


def test_between_ends() -> None:
    low, high, steps = -1e300, 1e300, 0
    while (middle := between(low, high)) is not None:
        low, high, steps = (middle, high, steps + 1) if middle <= 3.7 else (low, middle, steps + 1)
    assert steps <= 64
    assert (low, high) == (3.7, math.nextafter(3.7, 4))
    assert between(3, 4) is None
    assert between(-(2**40), 2**40) == 0
    assert step(3, 1) == 4
    assert step(0.0, 1) == 5e-324


def test_distance_to_the_hyperbola() -> None:
    product = Feature("mul", ("x", "y"))
    distance = boundary_distance(product, [np.array([30.0]), np.array([4.0])], np.array([120.0]), [1.0, 1.0], 0.0)
    assert distance.tolist() == [4.0]
    places = np.array([0.0, 99.0])
    near = boundary_distance(product, [places, places], places * places, [1.0, 1.0], 10000.0)
    assert 100 < near[0] < 200
    assert 0 < near[1] < 1.5


@pytest.mark.parametrize(
    ("operator", "outside", "inside"),
    [("<", math.inf, 1e308), ("<", math.inf, LARGEST), (">", LARGEST, math.inf), (">", -math.inf, -LARGEST)],
)
def test_thresholds_beside_infinity_are_finite(operator: str, outside: float, inside: float) -> None:
    feature = features_of({"x": "float64"})[0]
    literal = concrete(Candidate(feature, operator, 1.0, outside, inside))
    assert isinstance(literal.value, float)
    assert math.isfinite(literal.value)
    compare = {"<": lt, "<=": le, ">": gt, ">=": ge}[literal.operator]
    assert compare(inside, literal.value)
    assert not compare(outside, literal.value)
