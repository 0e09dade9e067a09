import math

import numpy as np

from riot_bus.generalize.features import Feature
from riot_bus.generalize.sampling import Variable
from riot_bus.generalize.table import Table

N = Feature("raw", ("n",))


def test_without_samples_nothing_can_be_told_apart() -> None:
    table = Table([Variable("n", "int32", 5)])
    table.add([], [])
    found, masks = table.candidates()
    assert found == []
    assert masks.shape == (0, 0)
    assert table.values(N) == []


def test_thresholds_lie_between_samples_of_different_outcome() -> None:
    table = Table([Variable("n", "int32", 500)])
    table.add([{"n": n} for n in (100, 200, 300, 400)], [False, False, True, True])
    found, masks = table.candidates()
    above = [index for index, each in enumerate(found) if (each.feature, each.operator) == (N, ">")]
    assert [(found[index].outside, found[index].inside) for index in above] == [(200, 300)]
    assert masks[above[0]].tolist() == [False, False, True, True]


def test_integers_beyond_64_bits_are_told_apart_exactly() -> None:
    big = 2**63
    table = Table([Variable("n", "uint64", big + 1)])
    table.add([{"n": big}, {"n": big + 1}], [False, True])
    found, masks = table.candidates()
    (above,) = [index for index, each in enumerate(found) if (each.feature, each.operator) == (N, ">")]
    assert (found[above].outside, found[above].inside) == (big, big + 1)
    assert masks[above].tolist() == [False, True]


def test_what_is_not_a_number_is_on_no_side_of_a_threshold() -> None:
    feature = Feature("raw", ("x",))
    table = Table([Variable("x", "float64", 2.0)])
    table.add([{"x": math.nan}, {"x": 1.0}, {"x": 2.0}], [True, False, True])
    found, masks = table.candidates()
    ordered = [masks[index] for index, each in enumerate(found) if each.feature == feature and each.operator in "<>"]
    assert ordered
    assert not np.array(ordered)[:, 0].any()
    (flag,) = [index for index, each in enumerate(found) if (each.feature.kind, each.operator) == ("nan", "is")]
    assert masks[flag].tolist() == [True, False, False]


def test_a_category_is_told_by_each_value_seen() -> None:
    table = Table([Variable("mode", "string", "auto")])
    table.add([{"mode": mode} for mode in ("auto", "manual", "off")], [True, False, False])
    found, masks = table.candidates()
    held = {(each.operator, each.inside): mask.tolist() for each, mask in zip(found, masks, strict=True)}
    assert held["==", "auto"] == [True, False, False]
    assert held["!=", "manual"] == [True, False, True]
