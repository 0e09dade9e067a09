from collections.abc import Callable

import pytest

from riot_bus.generalize.edges import Flip, edges_of, linear_features, middle_of
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
