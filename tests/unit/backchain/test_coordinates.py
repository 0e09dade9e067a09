from __future__ import annotations

import numpy as np
import pytest

from riot_bus.backchain.coordinates import CoordinateSearch
from riot_bus.backchain.encoding import Encoding, SearchField

X, Y = SearchField("x", 2.0, 1.0, -5000, 5000), SearchField("y", 3.0, 1.0, -5000, 5000)
MODE = SearchField("mode", 0.0, 0.5, 0, 6, integer=True)
REFUSED = 1e6


def search(fields, distance, *, most=200, at_once=1):
    """Return the points that are asked, in order, until one is at zero or nothing more is asked."""
    encoding = Encoding(tuple(fields))
    engine, asked = CoordinateSearch(encoding), []
    while len(asked) < most:
        vectors = []
        while len(vectors) < at_once and (vector := engine.ask()) is not None:
            vectors.append(vector)
        if not vectors:
            return asked
        points = [encoding.decode(vector) for vector in vectors]
        asked += points
        for vector, point in zip(vectors, points, strict=True):
            engine.tell(vector, distance(**point))
        if any(distance(**point) <= 0 for point in points):
            return asked
    return asked


@pytest.mark.parametrize("edge", [-15, -80, -3000, 40, 4000])
def test_two_answers_tell_where_a_line_meets_the_rule(edge):
    asked = search([X, Y], lambda x, y: (y - edge) * (1 if edge < 3 else -1))
    assert len(asked) <= 10
    assert asked[0] == {"x": 2.0, "y": 3.0}


def test_what_is_refused_is_halved():
    asked = search([X, Y], lambda x, y: REFUSED if abs(y) >= 100 else y + 97)
    assert -100 < asked[-1]["y"] <= -97
    assert len(asked) <= 8


def test_a_field_that_another_one_hides_is_followed_afterwards():
    asked = search([X, Y], lambda x, y: REFUSED if max(abs(x), abs(y)) >= 100 else max(y + 80, 80 - x))
    assert asked[-1]["y"] <= -80
    assert asked[-1]["x"] >= 80
    assert len(asked) <= 20


def test_few_values_are_all_tried_and_kept_for_what_follows():
    asked = search([X, MODE], lambda x, mode: max(1.0 if mode != 3 else -1.0, x + 50 if mode == 3 else 60.0))
    assert asked[-1]["mode"] == 3
    assert asked[-1]["x"] <= -50


def test_on_a_plateau_it_ends_after_steps_of_all_sizes():
    asked = search([X, Y], lambda x, y: 5.0)
    assert len(asked) == 1 + 3 * 4
    assert len({tuple(point.values()) for point in asked}) == len(asked)


def test_noise_alone_leads_nowhere():
    rng = np.random.default_rng(0)
    noise = {}

    def distance(**point):
        return noise.setdefault(tuple(point.values()), 100 + rng.normal())

    assert len(search([X, Y], distance)) == 13


@pytest.mark.parametrize("at_once", [1, 3, 8])
def test_answers_may_come_in_batches(at_once):
    asked = search([X, Y], lambda x, y: max(y + 80, 80 - x), at_once=at_once)
    assert asked[-1]["y"] <= -70
    assert len(asked) <= 40


def test_it_stays_within_the_range_and_stops_at_its_end():
    asked = search([SearchField("x", 2.0, 1.0, -10, 10)], lambda x: x + 50)
    assert min(point["x"] for point in asked) == -10
    assert len(asked) <= 25
