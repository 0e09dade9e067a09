import pytest

from riot_bus.generalize.features import FEATURE_KINDS, Feature
from riot_bus.generalize.forms.tree import FEATURES, NO_ROOTS, OPERATIONS, ROOTS, Tree, feature_tree, roots
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.errors import ConfigError


def operations(tree: Tree) -> set[str]:
    return {tree.operation}.union(*map(operations, tree.operands))


def test_each_kind_of_feature_has_a_tree() -> None:
    assert set(FEATURES) == set(FEATURE_KINDS)
    for kind, (count, *_) in FEATURE_KINDS.items():
        tree = feature_tree(Feature(kind, ("x", "y", "z")[:count]))
        assert tree.variables() == set("xyz"[:count])
        assert operations(tree) <= set(OPERATIONS)


def test_a_kind_without_a_tree_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.generalize.forms.tree.FEATURES", {})
    with pytest.raises(ConfigError, match="how 'abs\\(x\\)' is written elsewhere"):
        feature_tree(Feature("abs", ("x",)))


def test_each_kind_has_roots_for_each_variable_or_a_word_why_not() -> None:
    assert set(ROOTS) | set(NO_ROOTS) == set(FEATURE_KINDS)
    assert not set(ROOTS) & set(NO_ROOTS)
    for kind in ROOTS:
        assert len(ROOTS[kind]) == FEATURE_KINDS[kind][0]


def test_trees_have_as_many_operands_as_the_operation_takes() -> None:
    def check(tree: Tree) -> None:
        assert len(tree.operands) == OPERATIONS[tree.operation]
        for each in tree.operands:
            check(each)

    for kind, (count, *_) in FEATURE_KINDS.items():
        names = ("x", "y", "z")[:count]
        check(feature_tree(Feature(kind, names)))
        for name in names if kind in ROOTS else ():
            for root in roots(Literal(Feature(kind, names), ">", 3), name):
                check(root)


def test_categories_and_a_variable_that_comes_twice_have_no_roots() -> None:
    assert roots(Literal(Feature("raw", ("mode",)), "==", "auto"), "mode") == ()
    assert roots(Literal(Feature("raw", ("flag",)), "==", True), "flag") == ()
    assert roots(Literal(Feature("mul", ("x", "x")), ">", 4), "x") == ()
    assert roots(Literal(Feature("raw", ("x",)), ">", 4), "y") == ()
