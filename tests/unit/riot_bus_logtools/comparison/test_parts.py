from __future__ import annotations

import pytest

from riot_bus_logtools.comparison.parts import TopicDifference, TopicTiming


@pytest.mark.parametrize(
    ("facts", "same"),
    [
        ({}, True),
        ({"near": 5}, True),
        ({"left": {"stamp": 5}}, True),
        ({"changed": 1, "allowed": 9.0}, False),
        ({"lost": 1}, False),
        ({"added": 1}, False),
        ({"moved": 1}, False),
        ({"lost": 1, "added": 1, "moved": 1, "allowed": 3.0}, True),
        ({"lost": 1, "added": 1, "moved": 1, "allowed": 2.9}, False),
        ({"unaligned": (0, 1), "allowed": 9.0}, False),
        ({"labels": {"encoding": ("a", "b")}}, False),
        ({"timing": TopicTiming(0.1, 9.0, 3)}, True),
        ({"timing": TopicTiming(0.1, 9.0, 3, late=1)}, False),
    ],
)
def test_what_counts_as_a_difference(facts, same):
    assert TopicDifference("a", "", 10, 10, **facts).same is same
