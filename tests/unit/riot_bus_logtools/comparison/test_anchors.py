from __future__ import annotations

import random

from riot_bus_logtools.comparison.anchors import Gap, Twins, anchored, longest_rising


def whole(a, b):
    return Gap(range(len(a)), range(len(b)))


def test_equal_sequences_are_one_block():
    assert anchored("aaaa", "aaaa", whole("aaaa", "aaaa")) == ([Twins(0, 0, 4)], [])
    assert anchored("", "", whole("", "")) == ([], [])


def test_what_is_missing_stands_between_blocks():
    a, b = "abcdef", "abdef"
    assert anchored(a, b, whole(a, b)) == ([Twins(0, 0, 2), Twins(3, 2, 3)], [Gap(range(2, 3), range(2, 2))])


def test_several_differences_are_told_apart():
    a, b = "abcdefghij", "aXcdefgYhij"
    blocks, gaps = anchored(a, b, whole(a, b))
    assert gaps == [Gap(range(1, 2), range(1, 2)), Gap(range(7, 7), range(7, 8))]
    assert blocks == [Twins(0, 0, 1), Twins(2, 2, 5), Twins(7, 8, 3)]


def test_keys_that_come_more_than_once_are_no_anchors_but_count_at_the_ends():
    a, b = "xxxaxxx", "xxxbxxx"
    blocks, gaps = anchored(a, b, whole(a, b))
    assert (blocks, gaps) == ([Twins(0, 0, 3), Twins(4, 4, 3)], [Gap(range(3, 4), range(3, 4))])


def test_a_few_equal_keys_in_the_middle_may_be_chance():
    a, b = "abcdefgXhijk", "lmXnopqrstuv"
    assert anchored(a, b, whole(a, b)) == ([], [whole(a, b)])


def test_a_message_without_a_key_equals_none():
    keys = [None, None]
    assert anchored(keys, keys, whole(keys, keys)) == ([], [whole(keys, keys)])


def test_only_a_gap_is_looked_at():
    a, b = "ab12cd", "ab34cd"
    assert anchored(a, b, Gap(range(2, 4), range(2, 4))) == ([], [Gap(range(2, 4), range(2, 4))])


def test_the_longest_rising_part_is_as_long_as_any():
    rng = random.Random(7)
    for _ in range(50):
        numbers = rng.sample(range(100), 12)
        places = longest_rising(numbers)
        values = [numbers[place] for place in places]
        assert values == sorted(values)
        assert places == sorted(places)
        lengths = [1] * len(numbers)
        for at, number in enumerate(numbers):
            lengths[at] += max((lengths[k] for k in range(at) if numbers[k] < number), default=0)
        assert len(places) == max(lengths)
