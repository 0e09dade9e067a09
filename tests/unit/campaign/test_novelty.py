"""New behaviour: what it came of is found out, and built upon."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from riot_bus.campaign.covering import Covering
from riot_bus.campaign.novelty import Novelties
from riot_bus.campaign.variations import Placed, Variation
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, Verdict

POSITIONS = {"a": list(range(0, 120, 2)), "b": list(range(1, 120, 2))}


def thing(topic: str, value: int) -> Variation:
    return Variation(topic, (Injection(topic, "x", value),), f"{topic}:x")


def showing(*modes: str, verdict: Verdict = Verdict.PASS) -> Outcome:
    return Outcome(verdict, statistics={"behaviour": {"status:mode": ["ok", *modes]}})


def values(group: Sequence[Placed]) -> set[int]:
    return {int(str(each.item.injections[0].value)) for each in group}


def run(novelties: Novelties, group: tuple[Placed, ...], needed: set[int], most: int = 60) -> int:
    """Answer what is asked as a unit does that shows something while all of these values are there."""

    def outcome(part: Sequence[Placed]) -> Outcome:
        return showing(*(["limp"] if needed <= values(part) else []))

    novelties.know([showing()])
    novelties.learn(group, outcome(group))
    for trial in range(most):
        part = novelties.next()
        if not part:
            return trial
        novelties.record(part, outcome(part))
    return most


@pytest.mark.parametrize("needed", [{7}, {0}, {63}, {3, 40}, {0, 63}])
def test_what_new_behaviour_comes_of_is_told_apart(needed: set[int]) -> None:
    group = tuple(Placed(thing("ab"[number % 2], number), (number // 2,)) for number in range(64))
    novelties = Novelties(seed=0)
    trials = run(novelties, group, needed)
    (kept,) = novelties.kept
    assert values(kept) == needed
    assert trials <= 14 * len(needed) ** 2


def test_what_nominal_trials_show_and_what_was_seen_before_is_not_new() -> None:
    group = (Placed(thing("a", 1), (0,)), Placed(thing("b", 2), (0,)))
    novelties = Novelties(seed=0)
    novelties.know([showing("limp"), showing()])
    novelties.learn(group, showing("limp"))
    assert novelties.next() == ()
    novelties.learn(group, showing("stop"))
    part = novelties.next()
    assert part
    novelties.learn(group, showing("stop"))
    novelties.learn((), showing("late"))  # nothing had been delivered
    assert novelties.next() == ()
    assert novelties.seeds() == ([], ())


def test_the_same_part_is_asked_once_at_a_time() -> None:
    group = (Placed(thing("a", 1), (0,)), Placed(thing("b", 2), (0,)))
    novelties = Novelties(seed=0)
    novelties.learn(group, showing("one"))
    novelties.learn(group, showing("two"))
    part = novelties.next()
    assert novelties.next() == ()
    novelties.record(part, showing("one"))
    assert novelties.next() == part
    novelties.record(part, showing("one", "two"))
    assert [values(each) for each in novelties.kept] == [values(part)] * 2


def test_a_field_that_shows_all_that_comes_in_is_soon_no_news() -> None:
    novelties = Novelties(seed=0)
    novelties.know([showing()])
    group = (Placed(thing("a", 1), (0,)),)
    for number in range(100):
        novelties.learn(group, showing(str(number)))
    assert len(novelties.kept) <= 16


def test_chance_is_not_built_upon() -> None:
    """Nothing comes of a part that does not show it again."""
    group = tuple(Placed(thing("a", number), (number,)) for number in range(32))
    novelties = Novelties(seed=0)
    novelties.know([showing()])
    novelties.learn(group, showing("limp"))
    for _ in range(100):
        if part := novelties.next():
            novelties.record(part, showing())
    assert novelties.kept == []
    assert novelties.next() == ()


@pytest.mark.parametrize("needed", [{1}, {1, 2}])
def test_it_happens_in_later_trials_with_others_around_it(needed: set[int]) -> None:
    items = [thing(topic, number) for number in range(40) for topic in "ab"]
    covering = Covering(items, POSITIONS, seed=0)
    while not covering.finished:
        covering.record(covering.next(), Outcome(Verdict.PASS))
    group = (Placed(thing("a", 1), (3,)), Placed(thing("b", 2), (3,)))
    run(covering.novelties, group, needed)
    trials = [covering.further() for _ in range(40)]
    shown = [sum(each.item.injections[0].value == 1 and each.item.topic == "a" for each in trial) for trial in trials]
    assert sum(count > 0 for count in shown) >= 15
    assert max(len(each.firsts) for trial in trials for each in trial) > 1 or max(shown) > 1
    for trial in trials:
        taken = [(each.item.topic, first + n) for each in trial for first in each.firsts for n in range(each.item.span)]
        assert len(taken) == len(set(taken))
        assert all(0 <= number < len(POSITIONS[topic]) for topic, number in taken)


def test_equal_answers_give_equal_choices() -> None:
    def told() -> list[tuple[Placed, ...]]:
        covering = Covering([thing(topic, n) for n in range(20) for topic in "ab"], POSITIONS, seed=3)
        chance, found = random.Random(1), []
        for _ in range(60):
            group = covering.next() or covering.further()
            found.append(group)
            modes = [str(chance.randrange(4))]
            covering.record(group, showing(*modes))
            if part := covering.novelties.next():
                found.append(part)
                covering.novelties.record(part, showing(*modes))
        return found

    assert told() == told()
