import math

import pytest

from riot_bus.generalize.expressions import OPERATORS
from riot_bus.generalize.features import FEATURE_KINDS, Feature
from riot_bus.generalize.forms.function import compiled
from riot_bus.generalize.forms.tree import NO_ROOTS, OPERATIONS, ROOTS, Tree, feature_tree, roots
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.errors import ConfigError
from tests.rule_rows import feature_of, operations


def test_each_kind_of_feature_has_a_tree() -> None:
    for kind in FEATURE_KINDS:
        feature = feature_of(kind, ("x", "y", "z"))
        tree = feature_tree(feature)
        assert tree.variables() == set(feature.args)
        assert operations(tree) <= set(OPERATIONS)


def test_each_operator_of_expressions_has_an_operation() -> None:
    composed = {"signed", "not", "isfinite"}
    assert {"and": "bitand", "isnan": "nan"}.keys() | composed | set(OPERATIONS) >= OPERATORS


def test_an_operator_without_a_tree_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.generalize.forms.tree.OPERATIONS", {})
    with pytest.raises(ConfigError, match="'abs\\(x\\)' cannot be written in other forms"):
        feature_tree(Feature("abs", ("x",)))


def test_each_kind_has_roots_for_each_variable_or_a_word_why_not() -> None:
    assert set(ROOTS) | set(NO_ROOTS) == set(FEATURE_KINDS)
    assert not set(ROOTS) & set(NO_ROOTS)
    for kind in ROOTS:
        feature = feature_of(kind, ("x", "y", "z"))
        assert all(roots(Literal(feature, ">", 3), name) for name in feature.args)


def test_roots_are_where_a_feature_crosses_its_threshold() -> None:
    for kind in ROOTS:
        feature, values = feature_of(kind, ("x", "y", "z")), [5.0, 3.0, 2.0]
        names = ["x", "y", "z"]
        for name in feature.args:
            for root in roots(Literal(feature, ">", 6), name):
                moved = values.copy()
                moved[names.index(name)] = compiled(root, names)(values)
                found = compiled(feature_tree(feature), names)(moved)
                # The other variable may be the one that decides, and a ratio changes sign at 0.
                elsewhere = kind in ("maxabs", "minabs") or (kind == "div" and math.isinf(found))
                assert found == pytest.approx(6) or elsewhere or math.isnan(found), (kind, name)


def test_trees_have_as_many_operands_as_the_operation_takes() -> None:
    def check(tree: Tree) -> None:
        assert len(tree.operands) == OPERATIONS[tree.operation]
        for each in tree.operands:
            check(each)

    for kind in FEATURE_KINDS:
        feature = feature_of(kind, ("x", "y", "z"))
        check(feature_tree(feature))
        for name in feature.args if kind in ROOTS else ():
            for root in roots(Literal(feature, ">", 3), name):
                check(root)


def test_categories_and_a_variable_that_comes_twice_have_no_roots() -> None:
    assert roots(Literal(Feature("raw", ("mode",)), "==", "auto"), "mode") == ()
    assert roots(Literal(Feature("raw", ("flag",)), "==", True), "flag") == ()
    assert roots(Literal(Feature("mul", ("x", "x")), ">", 4), "x") == ()
    assert roots(Literal(Feature("raw", ("x",)), ">", 4), "y") == ()
