import math

import numpy as np
import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import FAR, Literal
from riot_bus.vocabulary.errors import ConfigError
from tests.rule_rows import columns, every_literal, rows

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
        (X, "in", 3, "needs a set"),
        (X, "==", (3, 4), "needs a set"),
        (X, "in", (3,), "with the set"),
        (X, "in", (3, 3), "with the set"),
        (X, "in", (3, "a"), "with the set"),
        (X, "in", (3.0, 4.0), "with the set"),
        (Feature("abs", ("x",)), "in", (3, 4), "with the set"),
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
    assert Literal(NAN, "not").text() == "not isnan(x)"
    assert Literal(Feature("nonfinite", ("x",)), "not").text() == "isfinite(x)"


def test_a_set_holds_for_its_members_and_its_opposite_for_others_of_their_type() -> None:
    columns = {"x": np.array([2, 3, 5]), "s": np.array(["a", "b", 1], dtype=object)}
    assert Literal(X, "in", (2, 5)).holds(columns).tolist() == [True, False, True]
    assert Literal(X, "not in", (2, 5)).holds(columns).tolist() == [False, True, False]
    assert Literal(X, "in", (2, 5)).distance(columns, {"x": 2.0}).tolist() == [-0.25, 0.5, -0.25]
    texts = Feature("raw", ("s",))
    assert Literal(texts, "not in", ("a", "c")).holds(columns).tolist() == [False, True, False]
    assert Literal(texts, "in", ("a", "c")).distance(columns, {}).tolist() == [-1.0, 1.0, 1.0]


def test_differences_are_written_as_comparisons_and_long_texts_are_cut() -> None:
    assert Literal(Feature("sub", ("i", "n")), ">=", 0).text() == "i >= n"
    assert Literal(Feature("sub", ("i", "n")), ">=", 1).text() == "i - n >= 1"
    assert Literal(Feature("linear", ("x", "y", "z"), (1, 1, -2)), ">", 0).text() == "x + y > 2 * z"
    assert Literal(Feature("mulsub", ("w", "h", "n")), "!=", 0).text() == "w * h != n"
    assert len(Literal(X, "==", "A" * 65536).text()) < 60
    assert Literal(X, "in", ("a", "b")).text() == 'x in ("a", "b")'


def test_the_distance_to_what_wraps_is_the_shorter_way_round() -> None:
    literal = Literal(Feature("wrap8", ("x", "y")), "<", 4)
    columns = {"x": np.array([250, 3, 100], dtype=np.uint8), "y": np.array([0, 0, 0], dtype=np.uint8)}
    assert literal.distance(columns, {}).tolist() == [6.0, -1.0, 96.0]


def test_the_distance_of_every_kind_is_negative_exactly_where_it_holds() -> None:
    kinds = {(literal.feature.kind, literal.operator, type(literal.value)): literal for literal in every_literal()}
    table = columns(rows(60, seed=4))
    for literal in kinds.values():
        far = literal.distance(table, {"a:i8": 4.0, "a:f64": 0.5})
        assert ((far <= 0) == literal.holds(table)).all(), literal.text()
        assert (far != 0).all(), literal.text()
        assert np.isfinite(far).all(), literal.text()
