"""Fields of crash regions."""

from collections.abc import Callable, Mapping, Sequence

import pytest

from riot_bus.backchain.axes import choose_axes

NOMINAL = {"alt": 500.0, "lat": 47.4, "lon": 8.5}
Point = Mapping[str, float]


def chosen(found: Point, fails_at: Callable[[Point], bool]) -> tuple[tuple[str, str], dict[str, float], int]:
    asked: list[Point] = []

    def fails(points: Sequence[Point]) -> list[bool]:
        asked.extend(points)
        return [fails_at({**NOMINAL, **point}) for point in points]

    axes, fixed = choose_axes(list(NOMINAL), {**NOMINAL, **found}, NOMINAL, fails)
    return axes, fixed, len(asked)


@pytest.mark.parametrize(
    ("found", "fails_at", "axes", "fixed", "trials"),
    [
        ({"lat": 50}, lambda at: at["lat"] > 48, ("alt", "lat"), {}, 1),
        ({"lon": 9}, lambda at: at["lon"] > 8.57, ("lon", "alt"), {}, 3),
        ({"lat": 50, "lon": 9}, lambda at: at["lon"] > 8.57 and at["lat"] > 48, ("lat", "lon"), {}, 4),
        ({"alt": 0, "lon": 9}, lambda at: at["lon"] > 8.57, ("lon", "alt"), {}, 4),
        (
            {"lat": 50, "lon": 9, "alt": 0},
            lambda at: at["lon"] > 8.57 and at["lat"] > 48 and at["alt"] < 5,
            ("alt", "lat"),
            {"lon": 9},
            4,
        ),
        ({}, lambda at: False, ("alt", "lat"), {"lon": 8.5}, 1),
    ],
)
def test_the_fields_that_decide_are_shown(
    found: Point, fails_at: Callable[[Point], bool], axes: tuple[str, str], fixed: Point, trials: int
) -> None:
    assert chosen(found, fails_at) == (axes, fixed, trials)
