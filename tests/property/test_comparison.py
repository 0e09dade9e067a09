"""What is planted into a sequence of messages is exactly what a comparison tells."""

from __future__ import annotations

from typing import Any, NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus_logtools.comparison.parts import TopicDifference
from tests.unit.riot_bus_logtools.comparison.recordings import of_topic

Row = dict[str, Any]


class Planted(NamedTuple):
    """Both sequences, and what was done at which places of the first one."""

    before: list[Row]
    after: list[Row]
    changed: list[int]
    lost: list[int]
    added: list[int]
    swapped: list[int]


@st.composite
def planted(draw: st.DrawFn, noise: float = 0.0, stamped: bool = False) -> Planted:
    """Messages of which each is another one, and a few edits that do not touch one another."""
    count = draw(st.integers(4, 80))
    before: list[Row] = [{"n": n, "x": n * 1.0, "y": draw(st.sampled_from([0.0, 1.0]))} for n in range(count)]
    places = draw(st.lists(st.integers(0, (count - 2) // 3), unique=True, max_size=6).map(sorted))
    found = Planted(before, [], [], [], [], [])
    kinds = {3 * place: draw(st.sampled_from(["changed", "lost", "added", "swapped"])) for place in places}
    place = 0
    while place < count:
        row, kind = dict(before[place]), kinds.get(place)
        match kind:
            case "changed":
                found.after.append({**row, "x": row["x"] + 1000.0})
                found.changed.append(place)
            case "lost":
                found.lost.append(place)
            case "added":
                found.added.append(len(found.after))
                found.after.extend([{"n": -1 - place, "x": -5.0, "y": 3.0}, row])
            case "swapped" if place + 1 < count:
                found.after.extend([dict(before[place + 1]), row])
                found.swapped.append(place)
                place += 1
            case _:
                found.after.append(row)
        place += 1
    for row in found.after:
        row["x"] += draw(st.floats(-noise, noise)) if noise else 0.0
    for begin, rows in enumerate((before, found.after) if stamped else ()):
        for number, row in enumerate(rows):
            row["stamp"] = 1000 * begin + number
    return found


def check(told: TopicDifference, edits: Planted) -> None:
    """Check that what is told is what was planted."""
    assert (told.lost_at, told.added_at) == (tuple(edits.lost), tuple(edits.added))
    assert [field.name for field in told.fields] == (["x"] if edits.changed else [])
    assert (told.changed, told.moved, told.unaligned) == (len(edits.changed), len(edits.swapped), (0, 0))
    moved = {one for one, _ in told.moved_at}
    assert all(len(moved & {place, place + 1}) == 1 for place in edits.swapped)
    assert told.equal == len(edits.before) - len(edits.changed) - len(edits.lost) - len(edits.swapped)
    assert told.same is not any((edits.changed, edits.lost, edits.added, edits.swapped))


@settings(deadline=None)
@given(planted())
def test_edits_are_told_as_they_were_made(edits: Planted) -> None:
    check(of_topic(edits.before, edits.after), edits)


@settings(deadline=None)
@given(planted(stamped=True))
def test_and_where_each_message_has_another_stamp(edits: Planted) -> None:
    check(of_topic(edits.before, edits.after), edits)


@settings(deadline=None)
@given(planted(noise=0.2))
def test_and_where_all_numbers_are_noisy(edits: Planted) -> None:
    check(of_topic(edits.before, edits.after, "a:x=0.25"), edits)


@settings(deadline=None)
@given(planted())
def test_both_ways_the_same_is_told(edits: Planted) -> None:
    told, turned = of_topic(edits.before, edits.after), of_topic(edits.after, edits.before)
    assert (told.changed, told.lost, told.added, told.moved) == (
        turned.changed,
        turned.added,
        turned.lost,
        turned.moved,
    )


few = st.lists(st.sampled_from([{"x": 0}, {"x": 1}, {"x": 1, "y": 2}, {}, b"", b"\x01"]), max_size=25)


@settings(deadline=None)
@given(few, few)
def test_nothing_is_counted_twice_or_not_at_all(before: list[Row | bytes], after: list[Row | bytes]) -> None:
    if not before and not after:
        return
    told = of_topic(before, after)
    pairs = told.equal + told.changed + told.moved
    assert (pairs + told.lost, pairs + told.added) == (len(before), len(after))
    assert told.same is (before == after)
