from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from riot_bus.campaign.covering import Covering
from riot_bus.campaign.schedule import message_faults, positions_of
from riot_bus.campaign.variations import Placed, Variation, sets_value
from riot_bus.inject.apply import inject_log
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Verdict


def test_a_thing_changes_the_messages_that_it_is_placed_on_each_time() -> None:
    item = Variation("t", (Injection("t", "a", 1), Injection("t", "b", 2)), "a and b", span=3, times=2)
    assert [(each.field, each.first, each.last) for each in Placed(item, (4, 10)).injections] == [
        ("a", 4, 6),
        ("b", 4, 6),
        ("a", 10, 12),
        ("b", 10, 12),
    ]


def test_lengths_and_faults_are_no_values_for_other_fields() -> None:
    kinds = (Injection("t", "a", 1), Injection("t", "len(a)", 1), Injection("t", fault="drop"))
    assert [sets_value(Variation("t", (each,), "a")) for each in kinds] == [True, False, False]


REGISTRY = TypeRegistry()


def log(*entries: tuple[float, str]) -> list[Message]:
    """Return a log whose payloads are the places of its messages."""
    return [Message(10**9 + round(time * 1e9), topic, b"%d" % at) for at, (time, topic) in enumerate(entries)]


def moves(messages: list[Message], topic: str, leave: Sequence[str] = ()) -> list[Variation]:
    return [each for each in message_faults(messages, REGISTRY, leave=leave) if each.moves and each.topic == topic]


def order(messages: list[Message], item: Variation, number: int) -> list[int]:
    delivered, _ = inject_log(messages, Placed(item, (number,)).injections, registry=REGISTRY)
    return [int(each.payload) for each in delivered]


def test_a_goal_comes_before_the_only_map() -> None:
    messages = log((0.0, "map"), (5.0, "goal"))
    (late,) = moves(messages, "map")
    (early,) = moves(messages, "goal")
    assert (late.about, early.about) == ("map delay", "goal early")
    assert order(messages, late, 0) == order(messages, early, 0) == [1, 0]
    messages = log((0.0, "map"), *((0.1 * n, "odom") for n in range(1, 40)), (5.0, "goal"), (5.1, "odom"))
    _, early = moves(messages, "goal")
    assert order(messages, early, 0) == [*range(1, 39), 40, 0, 39, 41]


def test_bursts_are_no_matter() -> None:
    messages = log(*((burst + 0.001 * n, "a") for burst in (0, 60) for n in range(6)), (30.0, "b"))
    messages.sort(key=lambda each: each.time)
    messages = [each.with_(payload=b"%d" % at) for at, each in enumerate(messages)]
    swap, late, other, early = moves(messages, "a")
    assert order(messages, swap, 2) == [0, 1, 3, 2, *range(4, 13)]
    assert order(messages, swap, 5) == [*range(5), 6, 7, 5, *range(8, 13)]  # b is in between
    assert order(messages, late, 0) == [*range(1, 12), 0, 12]
    assert order(messages, other, 0) == [*range(1, 7), 0, *range(7, 13)]
    assert list(other.moves.numbers) == list(range(6))
    assert list(early.moves.numbers) == list(range(6, 12))
    assert order(messages, early, 8) == [*range(6), 7, 8, 9, 6, *range(10, 13)]


def test_messages_of_the_same_time_are_moved_too() -> None:
    messages = log((0.0, "a"), (0.0, "a"), (0.0, "b"))
    swap, other = moves(messages, "a")
    assert order(messages, swap, 0) == [1, 2, 0]
    assert order(messages, other, 1) == [0, 2, 1]


def test_what_cannot_be_done_is_nothing_to_try() -> None:
    assert moves(log((0.0, "a")), "a") == []
    assert [each.about for each in moves(log((0.0, "a"), (1.0, "a")), "a")] == ["a delay"]
    assert moves(log((0.0, "map"), (5.0, "goal")), "goal", leave=["map:*"]) == []


def test_topics_that_are_left_alone_are_not_delayed() -> None:
    messages = log((0.0, "map"), (1.0, "mode"), (5.0, "goal"))
    faults = message_faults(messages, REGISTRY, leave=["mode:*"])
    assert {one.topic for each in faults for one in each.injections} == {"map", "goal"}
    (early,) = (each for each in faults if each.about == "goal early")
    assert order(messages, early, 0) == [1, 2, 0]


@pytest.mark.parametrize("seed", range(4))
def test_each_is_placed_where_it_can_be_done(seed: int) -> None:
    draw = random.Random(seed)
    times = sorted(draw.choice((draw.uniform(0, 1), draw.uniform(0, 100))) for _ in range(60))
    messages = log(*((time, draw.choice("aaab")) for time in times))
    positions = positions_of(messages, REGISTRY)
    items = [each for each in message_faults(messages, REGISTRY) if each.moves]
    assert len(items) == 8
    covering = Covering(items, positions, seed=seed)
    placed = []
    while not covering.finished:
        group = covering.next()
        placed += group
        covering.record(group, Outcome(Verdict.PASS))
    for each in [*placed, *(each for _ in range(40) for each in covering.further())]:
        reached: list[list[int]] = []
        delivered, _ = inject_log(messages, each.injections, registry=REGISTRY, reached=reached)
        assert reached
        assert all(reached)
        assert each.item.span > 1 or [int(one.payload) for one in delivered] != list(range(60))
