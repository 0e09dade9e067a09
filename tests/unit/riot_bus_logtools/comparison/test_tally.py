from __future__ import annotations

import math

from riot_bus_logtools.comparison import tally
from riot_bus_logtools.comparison.fields import FieldChange
from riot_bus_logtools.comparison.tally import Tally
from riot_bus_logtools.comparison.tolerances import EXACT, IGNORED, Tolerance


def change(before, after, *, path="x", name=None, rule=EXACT, allowed=False):
    return FieldChange(path, name or path, before, after, rule, allowed)


def test_the_worst_example_is_kept():
    found = Tally()
    for number, after in enumerate((1.5, 4.0, 2.0)):
        found.take([change(1.0, after)], number, number + 1, 0.1 * number)
    (field,) = found.fields()
    assert (field.messages, field.largest, field.typical, field.low, field.high) == (3, 3.0, 1.0, 1.0, 4.0)
    assert (field.example.a, field.example.b, field.example.seconds) == (1, 2, 0.1)
    assert (field.example.before, field.example.after, field.whole) == (1.0, 4.0, False)
    assert (found.changed, list(found.changed_at)) == (3, [0, 1, 2])


def test_of_texts_the_first_example_is_kept():
    found = Tally()
    for number, after in enumerate(("b", "c")):
        found.take([change("a", after)], number, number, 0.0)
    (field,) = found.fields()
    assert (field.largest, field.unlike, field.example.after) == (None, 2, "b")


def test_elements_of_one_message_are_one_message():
    found = Tally()
    found.take([change(1, 2, path=f"r[{n}]", name="r[*]") for n in range(5)], 0, 0, 0.0)
    (field,) = found.fields()
    assert (field.name, field.messages, field.whole, found.changed) == ("r[*]", 1, True, 1)


def test_what_is_tolerated_is_counted_apart():
    found = Tally()
    found.take([], 0, 0, 0.0)
    found.take([change(1, 2, rule=Tolerance(1), allowed=True)], 1, 1, 0.0)
    found.take([change(1, 2, rule=IGNORED, allowed=True)], 2, 2, 0.0)
    found.take([change(1, 2, rule=IGNORED, allowed=True), change(1, 9, path="y")], 3, 3, 0.0)
    assert (found.same_fields, found.near, found.changed, found.left) == (1, 1, 1, {"x": 2})
    assert [each.name for each in found.fields()] == ["y"]


def test_infinities_and_nan_are_infinitely_far():
    for odd in (math.inf, math.nan):
        found = Tally()
        found.take([change(1.0, odd)], 0, 0, 0.0)
        (field,) = found.fields()
        assert (field.largest, field.low, field.high) == (math.inf, 1.0, 1.0)
    found = Tally()
    found.take([change(-math.inf, math.inf)], 0, 0, 0.0)
    assert (found.fields()[0].low, found.fields()[0].high) == (None, None)


def test_the_median_of_many_is_nearly_that_of_all():
    found = Tally()
    for number in range(50_000):
        found.take([change(0.0, float(number))], number, number, 0.0)
    (field,) = found.fields()
    assert abs(field.typical - 25_000) < 100
    assert field.largest == 49_999.0


def test_fields_are_bounded_and_so_are_their_values(monkeypatch):
    monkeypatch.setattr(tally, "MOST_FIELDS", 3)
    found = Tally()
    found.take([change("a" * 10_000, b"b" * 10_000, path=f"f{n}") for n in range(10)], 0, 0, 0.0)
    names = {each.name: each for each in found.fields()}
    assert set(names) == {"f0", "f1", "f2", "(other fields)"}
    example = names["f0"].example
    assert example.before.endswith("... (10000 characters)")
    assert example.after.endswith("... (10000 bytes)")
    assert len(example.before) + len(example.after) < 1000


def test_fields_that_differ_most_often_come_first():
    found = Tally()
    found.take([change(1, 2, path="b"), change(1, 2, path="a")], 0, 0, 0.0)
    found.take([change(1, 2, path="b")], 1, 1, 0.0)
    assert [each.name for each in found.fields()] == ["b", "a"]
