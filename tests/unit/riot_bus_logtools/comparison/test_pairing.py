from __future__ import annotations

import pytest

from riot_bus.types.registry import TypeRegistry
from riot_bus_logtools.comparison import band, pairing
from riot_bus_logtools.comparison.anchors import Gap, anchored
from riot_bus_logtools.comparison.fields import Shapes, differing
from riot_bus_logtools.comparison.pairing import Half, paired
from riot_bus_logtools.comparison.tolerances import tolerances_of
from tests.unit.riot_bus_logtools.comparison.recordings import said


def pairs_of(rows_a, rows_b, *texts: str):
    """What belongs together of two topics with these rows."""
    rules = tolerances_of(texts).of_topic(lambda text: True)
    shapes, registry = Shapes(rules), TypeRegistry()
    a, b = ([shapes.read(message, registry) for message in said(*rows)] for rows in (rows_a, rows_b))
    hashes = [[each.message.payload for each in some] for some in (a, b)]
    blocks, gaps = anchored(*hashes, Gap(range(len(a)), range(len(b))))
    return paired(
        blocks,
        gaps,
        Half(hashes[0], a.__getitem__),
        Half(hashes[1], b.__getitem__),
        same=lambda one, other: all(each.allowed for each in differing(a[one], b[other], rules)),
    )


def numbered(count, **more):
    return [{"n": number, "x": number * 1.5, **more} for number in range(count)]


def test_equal_bytes_are_not_looked_into():
    found = pairs_of(numbered(5), numbered(5))
    assert (found.blocks, found.pairs, found.lost, found.added) == ([(0, 0, 5)], [], [], [])


def test_one_that_is_lost_in_the_middle_of_messages_that_all_differ():
    rows = [{"x": float(number)} for number in range(20)]
    noisy = [{"x": row["x"] + 0.01 * (number % 3 + 1)} for number, row in enumerate(rows)]
    del noisy[7]
    found = pairs_of(rows, noisy)
    assert found.lost == [7]
    assert found.pairs == [(n, n - (n > 7)) for n in range(20) if n != 7]


def test_equal_content_belongs_together_though_its_bytes_differ():
    a = [{**row, "stamp": 100 + place} for place, row in enumerate(numbered(6))]
    b = [{**row, "stamp": 200 + place} for place, row in enumerate(numbered(6))]
    del b[2]
    found = pairs_of(a, b)
    assert (found.lost, found.pairs) == ([2], [(0, 0), (1, 1), (3, 2), (4, 3), (5, 4)])


def test_stamps_tell_which_belong_together_where_all_else_differs():
    a = [{"stamp": place, "x": "a"} for place in range(8)]
    b = [{"stamp": place, "x": "b"} for place in range(8) if place != 3]
    assert pairs_of(a, b).lost == [3]
    number = [{"seq": place, "x": place % 2} for place in range(8)]
    other = [{"seq": place, "x": place % 2 + 5} for place in range(8) if place != 4]
    assert pairs_of(number, other).lost == [4]


def test_stamps_do_not_tell_where_less_differs_without_them():
    a = [{"stamp": place, "x": place} for place in range(8)]
    b = [{"stamp": place + 1, "x": place} for place in range(8)]
    found = pairs_of(a, b)
    assert (found.pairs, found.lost, found.added) == ([(n, n) for n in range(8)], [], [])


def test_neighbours_that_have_changed_places():
    rows = numbered(6)
    found = pairs_of(rows, [rows[n] for n in (0, 1, 3, 2, 4, 5)])
    assert found.moved in ([(2, 3)], [(3, 2)])
    assert (found.lost, found.added, found.pairs) == ([], [], [])


def test_messages_that_have_changed_places_far_from_one_another():
    rows = numbered(9)
    found = pairs_of(rows, [rows[n] for n in (0, 7, 2, 3, 4, 5, 6, 1, 8)])
    assert (found.moved, found.lost, found.added, found.pairs) == ([(1, 7), (7, 1)], [], [], [])


def test_many_that_have_changed_places():
    rows = numbered(41)
    swapped = [rows[n + 1 if n % 2 == 0 else n - 1] for n in range(40)] + rows[40:]
    found = pairs_of(rows, swapped)
    assert (len(found.moved), found.lost, found.added, found.pairs) == (20, [], [], [])
    turned = [rows[n] for n in (0, 15, 2, 3, 4, 5, 1, 7, 8, 9, 10, 11, 12, 13, 14, 6, *range(16, 41))]
    found = pairs_of(rows, turned)
    assert (found.moved, found.lost, found.added, found.pairs) == ([(1, 6), (6, 15), (15, 1)], [], [], [])


def test_whoever_is_wanted_and_has_changed_stays():
    rows = numbered(20)
    other = [*rows]
    other[3], other[12] = rows[12], {"n": -1, "x": 0.5}
    found = pairs_of(rows, other)
    assert (found.moved, found.lost, found.added, found.pairs) == ([], [], [], [(3, 3), (12, 12)])


def test_values_that_come_often_tell_nothing_of_places():
    a = [{"x": flag} for flag in (0, 0, 1, 1, 0, 0, 1, 1, 0, 0)]
    b = [{"x": flag} for flag in (0, 0, 0, 1, 0, 0, 1, 1, 1, 0)]
    found = pairs_of(a, b)
    assert (found.pairs, found.moved) == ([(n, n) for n in range(2, 9)], [])


def test_one_that_is_out_of_order_within_tolerances():
    rows = numbered(6)
    later = [{**rows[n], "x": rows[n]["x"] + 0.1} for n in (0, 2, 3, 4, 1, 5)]
    found = pairs_of(rows, later, "a:x=0.2")
    assert (found.moved, found.lost, found.added) == ([(1, 4)], [], [])
    assert found.pairs == [(0, 0), (2, 1), (3, 2), (4, 3), (5, 5)]


def test_looking_for_moves_ends(monkeypatch):
    monkeypatch.setattr(pairing, "_MOST_TRIES", 0)
    rows = numbered(6)
    later = [{**rows[n], "x": rows[n]["x"] + 0.1} for n in (0, 2, 3, 4, 1, 5)]
    found = pairs_of(rows, later, "a:x=0.2")
    assert (found.moved, found.lost, found.added) == ([], [1], [4])


def test_what_cannot_be_aligned_is_told(monkeypatch):
    monkeypatch.setattr(band, "MOST_CELLS", 10)
    a, b = [{"x": f"a{n}"} for n in range(30)], [{"x": f"b{n}"} for n in range(20)]
    same = [{"x": "both"}]
    found = pairs_of(same + a + same, same + b + same)
    assert found.unaligned == [Gap(range(1, 31), range(1, 21))]
    assert (found.pairs, found.lost, found.added) == ([], [], [])


def test_what_has_names_is_aligned_however_much_it_is(monkeypatch):
    monkeypatch.setattr(band, "MOST_CELLS", 10)
    a, b = [{"seq": n, "x": f"a{n}"} for n in range(30)], [{"seq": n, "x": f"b{n}"} for n in range(30) if n != 9]
    found = pairs_of(a, b)
    assert (len(found.pairs), found.lost, found.unaligned) == (29, [9], [])


@pytest.mark.parametrize("count", [0, 1, 5])
def test_all_lost_and_all_added(count):
    rows = numbered(count)
    assert pairs_of(rows, []).lost == pairs_of([], rows).added == list(range(count))
