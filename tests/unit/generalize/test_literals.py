import math

import numpy as np
import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import FAR, Literal
from riot_bus.vocabulary.errors import ConfigError

X = Feature("raw", ("x",))
NAN = Feature("nan", ("x",))


@pytest.mark.parametrize(
    ("feature", "operator", "value", "message"),
    [
        (X, "=", 1, "does not fit"),
        (X, "is", None, "does not fit"),
        (NAN, ">", 1, "does not fit"),
        (NAN, "is", 1, "not compared"),
        (X, ">", math.inf, "finite"),
        (X, ">", "a", "cannot be compared"),
        (X, "==", None, "cannot be compared"),
        (Feature("abs", ("x",)), "==", True, "cannot be compared"),
    ],
)
def test_what_does_not_fit_together_is_refused(feature: Feature, operator: str, value: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Literal(feature, operator, value)  # type: ignore[arg-type]


def test_a_column_of_texts_is_far_from_every_threshold() -> None:
    columns = {"x": np.array(["a", "b"], dtype=object)}
    literal = Literal(X, ">", 3)
    assert not literal.holds(columns).any()
    assert literal.distance(columns, {}).tolist() == [FAR, FAR]


def test_a_category_holds_for_its_own_type_alone() -> None:
    mixed = {"x": np.array([True, 1, "1", b"1", None], dtype=object)}
    assert Literal(X, "==", True).holds(mixed).tolist() == [True, False, False, False, False]
    assert Literal(X, "!=", "2").holds(mixed).tolist() == [False, False, True, False, False]
    assert Literal(X, "==", b"1").holds({"x": np.array([1, 2])}).tolist() == [False, False]


def test_a_flag_and_its_opposite_hold_on_opposite_rows() -> None:
    columns = {"x": np.array([math.nan, 1.0])}
    assert Literal(NAN, "is").holds(columns).tolist() == [True, False]
    assert Literal(NAN, "not").holds(columns).tolist() == [False, True]
    assert Literal(NAN, "not").distance(columns, {}).tolist() == [1.0, -1.0]
    assert Literal(NAN, "not").text() == "not (isnan(x))"
