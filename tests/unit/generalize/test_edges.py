from collections.abc import Callable

import pytest

from riot_bus.generalize.edges import Flip, edges_of, farther_base, linear_features, middle_of
from riot_bus.generalize.features import Feature
from riot_bus.generalize.sampling import Assignment, Variable

INTEGERS = [Variable(name, "int32", 10**6) for name in ("x", "y", "z")]


def narrowed(nominal: Assignment, fails: Callable[[Assignment], bool], far: int = 10**6) -> list[Flip]:
    """Bisect the edges that exist at +-far."""
    rows: list[Assignment] = [nominal, *({**nominal, name: side * far} for name in nominal for side in (1, -1))]
    while True:
        edges = edges_of(INTEGERS, nominal, rows, [fails(row) for row in rows])
        wide = [(edge.name, middle_of(edge, "int32")) for edge in edges if not edge.narrow]
        if not wide:
            return edges
        rows += [{**nominal, name: value} for name, value in wide if value is not None]


@pytest.mark.parametrize(
    ("weights", "text"),
    [
        ({"x": 1, "y": 400, "z": 0}, "400 * y + x"),
        ({"x": 1, "y": 1, "z": -2}, "x + y - 2 * z"),
        ({"x": -640, "y": -1, "z": 1}, "640 * x + y - z"),
        ({"x": 2, "y": 3, "z": 0}, "3 * y + 2 * x"),
    ],
)
def test_coefficients_come_from_edges(weights: dict[str, int], text: str) -> None:
    nominal: Assignment = {"x": 7, "y": 9, "z": 11}

    def total(row: Assignment) -> int:
        return sum(weight * int(row[name]) for name, weight in weights.items())

    limit = total(nominal) + 150_000
    edges = narrowed(nominal, lambda row: total(row) > limit)
    assert text in {feature.text() for feature in linear_features(edges)}


def test_a_difference_of_two_is_no_linear_feature_and_one_edge_tells_nothing() -> None:
    nominal: Assignment = {"x": 7, "y": 9, "z": 11}
    edges = narrowed(nominal, lambda row: int(row["x"]) - int(row["y"]) > 1000)
    assert {edge.name for edge in edges} == {"x", "y"}
    assert linear_features(edges) == []
    assert linear_features(edges[:1]) == []


def test_wide_edges_and_chance_ratios_tell_nothing() -> None:
    assert linear_features([Flip("x", 0, 100, 900), Flip("y", 0, 3, 4)]) == []
    odd = linear_features([Flip("x", 0.0, 1234567.0, 1234567.1), Flip("y", 0.0, 1.0, 1.0000001)])
    assert all(isinstance(feature, Feature) and len(str(max(feature.constant))) < 8 for feature in odd)  # type: ignore[arg-type]


def test_the_smallest_failing_value_counts_where_floats_cannot_tell_distances() -> None:
    """From 9.5, 1e-300 and 5e-324 are equally far."""
    nominal: Assignment = {"x": 3.0, "z": 9.5}
    variables = [Variable(name, "float64", 1e6) for name in nominal]
    rows: list[Assignment] = [nominal, {**nominal, "z": 5e-324}, {**nominal, "z": 4.0}, {**nominal, "z": -7.0}]
    for _ in range(12):
        (edge,) = edges_of(variables, nominal, rows, [2 * float(row["z"]) < float(row["x"]) for row in rows])
        rows.append({**nominal, "z": middle_of(edge, "float64")})
    assert edge.narrow
    assert (edge.failing, edge.passing) == (pytest.approx(1.5, abs=0.01), pytest.approx(1.5, abs=0.01))


def test_the_middle_of_an_edge_halves_its_distance_from_nominal() -> None:
    assert middle_of(Flip("x", 0.0, 6.0, 8.0), "float64") == 7.0
    assert middle_of(Flip("x", 10.0, 11.0, 10010.0), "float64") == 110.0
    assert middle_of(Flip("x", 10, 9, -9990), "int32") == -90
    assert middle_of(Flip("x", 0, 6, 7), "int32") is None
    assert middle_of(Flip("x", 0.0, 1.0, 1e308), "float64") == pytest.approx(1e154)
    assert 1e300 < middle_of(Flip("x", 0.0, 1e300, 1.7e308), "float64") < 1.7e308  # type: ignore[operator]


def test_a_case_farther_from_the_edges_of_integers_gives_their_coefficients() -> None:
    def fails(row: Assignment) -> bool:
        return 640 * int(row["y"]) + int(row["x"]) >= 307200

    types = dict.fromkeys("xyz", "int32")
    near: Assignment = {"x": 7, "y": 450, "z": 11}
    edges = narrowed(near, fails)
    assert "640 * y + x" not in {feature.text() for feature in linear_features(edges)}
    farther = farther_base(edges, near, types)
    assert farther == {"x": 7, "y": -520, "z": 11}
    edges = narrowed(farther, fails)
    assert "640 * y + x" in {feature.text() for feature in linear_features(edges)}
    assert farther_base(edges, farther, types) is None
    unsigned = farther_base(narrowed(near, fails), near, dict.fromkeys("xyz", "uint32"))
    assert unsigned == {"x": 7, "y": 0, "z": 11}
    assert farther_base([Flip("y", 0, 479, 480)], {"y": 0}, {"y": "uint32"}) is None
    both = [Flip("y", 450, 479, 480), Flip("y", 450, -480, -481)]  # 520 below one edge is beyond the other
    assert farther_base(both, {"y": 450}, {"y": "int32"}) is None
