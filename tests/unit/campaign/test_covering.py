"""Everything is tried, in few trials, and what fails is found out though much is tried at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.campaign.covering import Covering, failure_rates
from riot_bus.campaign.variations import Placed, Variation
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, Verdict, Violation

CRASH = Violation("crash", "part", "crash in part")
Log = dict[str, list[int]]


def log(topics: int, messages: int) -> Log:
    """Topics by turns."""
    return {f"t{topic}": [number * topics + topic for number in range(messages)] for topic in range(topics)}


def items(topics: int, fields: int, values: int) -> list[Variation]:
    return [
        Variation(f"t{field % topics}", (Injection(f"t{field % topics}", f"f{field}", value),), f"f{field}")
        for field in range(fields)
        for value in range(values)
    ]


def crash_on(bad: Callable[[Injection], bool], log: Log, *, late: int = 0) -> Callable[[Sequence[Placed]], Outcome]:
    """Return a unit that crashes on the first bad message; `late` more are sent before that is noticed."""

    def run(group: Sequence[Placed]) -> Outcome:
        places = [log[each.item.topic][each.firsts[0]] for each in group if any(map(bad, each.injections))]
        if not places:
            return Outcome(Verdict.PASS, statistics={"played": 10**6, "outputs": 100})
        return Outcome(Verdict.FAIL, (CRASH,), statistics={"played": min(places) + 1 + late, "outputs": min(places)})

    return run


def cover(covering: Covering, run: Callable[[Sequence[Placed]], Outcome], most: int = 10_000) -> list[Sequence[Placed]]:
    asked = []
    while group := covering.next():
        asked.append(group)
        covering.record(group, run(group))
        assert len(asked) <= most
    return asked


@pytest.mark.parametrize(("fields", "most"), [(40, 120), (200, 500)])
@pytest.mark.parametrize("seed", range(5))
def test_all_pairs_are_tried_in_few_trials(fields: int, most: int, seed: int) -> None:
    places, every = log(4, 500), items(4, fields, 50)
    covering = Covering(every, places, seed=seed)
    asked = cover(covering, crash_on(lambda one: one.field == "f7" and one.value == 3, places))
    assert len(asked) <= most
    assert covering.covered == covering.total == len(every)
    assert {id(placed.item) for group in asked for placed in group if not placed.item.again} == set(map(id, every))


def test_what_fails_is_found_alone() -> None:
    places = log(2, 100)

    def bad(one: Injection) -> bool:
        return (one.field, one.value) in {("f3", 5), ("f8", 1), ("f8", 2)}

    covering = Covering(items(2, 10, 20), places, seed=1)
    asked = cover(covering, crash_on(bad, places, late=40))
    alone = [group[0].injections[0] for group in asked if len(group) == 1 and bad(group[0].injections[0])]
    assert {(one.field, one.value) for one in alone} == {("f3", 5), ("f8", 1), ("f8", 2)}
    assert covering.covered == 200


def test_what_cannot_be_judged_is_told_apart_like_a_failure_and_not_called_tried() -> None:
    places, every = log(2, 100), items(2, 8, 8)
    culprit = every[11].injections

    def run(group: Sequence[Placed]) -> Outcome:
        deadly = any(each.item.injections == culprit for each in group)
        return Outcome(Verdict.UNJUDGED if deadly else Verdict.PASS)

    covering = Covering(every, places, seed=0)
    asked = cover(covering, run)
    assert [[one.item.injections for one in group] for group in asked].count([culprit]) == 1
    assert sum(run(group).verdict is Verdict.UNJUDGED for group in asked) < 10
    assert {item.injections for item, _ in covering.tried} == {each.injections for each in every} - {culprit}
    assert not any(failed for _, failed in covering.tried)


def test_rates_are_those_of_what_failed_alone() -> None:
    places = log(2, 100)
    covering = Covering(items(2, 10, 20), places, seed=1)
    cover(covering, crash_on(lambda one: one.field == "f8" and one.value in (1, 2), places))
    rates = failure_rates(covering.tried, lambda item: item.about)
    assert {name: (rate.hits, rate.total) for name, rate in rates.items()} == {
        f"f{field}": (2 * (field == 8), 20) for field in range(10)
    }


def test_what_has_failed_together_is_undecided_until_it_is_told_apart() -> None:
    covering = Covering(items(1, 1, 8), log(1, 100), seed=1)
    passed, failed = (Outcome(verdict, statistics={"outputs": 9}) for verdict in (Verdict.PASS, Verdict.FAIL))
    for _ in range(2):
        covering.record(covering.next(), passed)
    group = covering.next()
    covering.record(group, failed)
    assert [id(item) for item in covering.undecided] == [id(placed.item) for placed in group]
    assert len(group) == 4
    for outcome in (failed, passed, passed, passed):
        covering.record(covering.next(), outcome)
    assert covering.undecided == []


def test_after_a_failure_further_values_of_its_field_come_last() -> None:
    places = log(2, 200)
    covering = Covering(items(2, 10, 20), places, seed=2)
    asked = cover(covering, crash_on(lambda one: one.field == "f4", places))
    first = next(at for at, group in enumerate(asked) if len(group) == 1 and group[0].item.about == "f4")
    others = [at for at, group in enumerate(asked) if any(placed.item.about != "f4" for placed in group)]
    late = [at for at, group in enumerate(asked) if at > first and {each.item.about for each in group} == {"f4"}]
    assert len(late) >= 10
    assert max(others) < min(late[-10:])
    assert covering.covered == 200


def test_malformed_payloads_come_after_what_is_plausible() -> None:
    places = log(2, 200)
    every = [replace(item, malformed=item.about in ("f1", "f6")) for item in items(2, 10, 20)]
    covering = Covering(every, places, seed=2)
    asked = cover(covering, crash_on(lambda one: one.field in ("f1", "f6"), places))
    malformed = [{placed.item.malformed for placed in group if not placed.item.again} for group in asked]
    assert {True, False} not in malformed
    assert malformed.index({True}) > max(at for at, kinds in enumerate(malformed) if kinds == {False})
    assert covering.covered == covering.total == 200


def test_beside_values_of_fields_that_fail_malformed_payloads_are_tried_as_well() -> None:
    places = log(1, 200)
    every = [replace(item, malformed=item.about == "f1") for item in items(1, 4, 30)]
    covering = Covering(every, places, seed=2)
    run = crash_on(lambda one: one.field in ("f1", "f2"), places)
    assert covering.malformed() == ()
    while not (unchecked := covering.malformed()):
        group = covering.next()
        covering.record(group, run(group))
    assert {placed.item.about for placed in unchecked} == {"f1"}
    assert {item.about for item, _ in covering.tried} >= {"f0", "f2", "f3"}
    covering.record(unchecked, run(unchecked))
    cover(covering, run)
    assert covering.covered == 120


def test_what_came_last_before_a_crash_is_tried_alone_next_as_long_as_it_is_the_cause() -> None:
    places = log(1, 200)
    covering = Covering(items(1, 20, 10), places, seed=4)
    run, alone = crash_on(lambda one: one.field == "f5" and one.value == 3, places), 0
    while group := covering.next():
        outcome = run(group)
        covering.record(group, outcome)
        if outcome.verdict is Verdict.FAIL and len(group) > 1:
            (last,) = covering.next()
            assert last.injections[0].field == "f5"
            covering.record((last,), run((last,)))
            alone += 1
    assert alone == 1
    assert covering.covered == 200


def test_what_crashes_hide_is_not_given_up() -> None:
    places = log(1, 30)
    covering = Covering(items(1, 3, 40), places, seed=5)
    cover(covering, crash_on(lambda one: one.field == "f1", places))
    assert covering.covered == 120


def test_what_may_hang_waits_while_a_campaign_is_calm_and_is_tried_later() -> None:
    places = log(1, 200)
    covering = Covering(items(1, 4, 10), places, seed=3)
    hang = Violation("hang", "part", "hang of part: in spin")

    def run(group: Sequence[Placed]) -> Outcome:
        bad = any(each.item.about == "f1" for each in group)
        return Outcome(Verdict.FAIL if bad else Verdict.PASS, (hang,) if bad else ())

    def step(*, calm: bool) -> set[str]:
        group = covering.next(calm=calm) or covering.further()
        covering.record(group, run(group))
        return {each.item.about for each in group}

    while not any(failed for _, failed in covering.tried):
        step(calm=False)
    tried = covering.covered
    assert all("f1" not in step(calm=True) for _ in range(100))
    assert covering.covered - tried > 0
    assert not covering.finished
    while not covering.finished:
        step(calm=False)
    assert covering.covered == 40


def test_what_is_silenced_by_others_is_tried_without_them() -> None:
    """After a bad mode the unit ignores all, so that nothing which comes later has been tried."""
    places = log(1, 100)

    def run(group: Sequence[Placed]) -> Outcome:
        modes = [each.firsts[0] for each in group if each.item.about == "f0"]
        silent_from = min(modes, default=100)
        crashes = [each.firsts[0] for each in group if each.item.about == "f1" and each.firsts[0] < silent_from]
        if crashes:
            return Outcome(Verdict.FAIL, (CRASH,), statistics={"played": 100, "outputs": min(crashes)})
        return Outcome(Verdict.PASS, statistics={"played": 100, "outputs": silent_from})

    asked = cover(Covering(items(1, 20, 2), places, seed=4), run)
    found = [group for group in asked if run(group).verdict is Verdict.FAIL]
    assert any(len(group) == 1 and group[0].item.about == "f1" for group in found)


def test_what_changes_nothing_is_put_elsewhere_and_at_last_not_called_tried() -> None:
    """A field may have the value already in some messages, or be in none."""
    places = log(1, 40)

    def run(group: Sequence[Placed]) -> Outcome:
        changes = [(one.field, each.firsts[0]) for each in group for one in each.injections]
        hits = [0 if field == "f0" or (field == "f1" and first % 2) else 1 for field, first in changes]
        return Outcome(Verdict.PASS, statistics={"played": 40, "outputs": 100, "delivered": hits})

    covering = Covering(items(1, 3, 8), places, seed=6)
    asked = cover(covering, run)
    tried = Counter(item.about for item, _ in covering.tried)
    assert (tried["f0"], tried["f2"]) == (0, 8)
    assert tried["f1"] >= 4
    assert max(Counter(id(each.item) for group in asked for each in group if not each.item.again).values()) == 3


def test_the_same_answers_give_the_same_choices() -> None:
    places = log(3, 50)
    run = crash_on(lambda one: one.value == 9, places)
    first, again = (cover(Covering(items(3, 12, 10), places, seed=5), run) for _ in range(2))
    assert first == again


def test_what_was_tried_is_varied_further_without_an_end() -> None:
    """A unit fails if two fields of a message are 9, if a field is 7 three times in a row, and in a mode of its own."""
    places = log(2, 60)

    def run(group: Sequence[Placed]) -> Outcome:
        at = {(each.item.topic, each.firsts[0] + n): each for each in group for n in range(each.item.span)}
        fails = []
        for (topic, number), each in at.items():
            values = {one.field: one.value for one in each.injections}
            row = [at.get((topic, number + n)) is each and values.get("f3") == 7 for n in range(3)]
            mode = values.get("f5") == 1 and 50 <= number < 54
            if {"f2": 9, "f4": 9}.items() <= values.items() or all(row) or mode:
                fails.append(places[topic][number])
        if not fails:
            return Outcome(Verdict.PASS, statistics={"played": 10**6, "outputs": 100})
        return Outcome(Verdict.FAIL, (CRASH,), statistics={"played": min(fails) + 1, "outputs": min(fails)})

    covering = Covering(items(2, 8, 12), places, seed=3)
    found = []
    for _ in range(400):
        group = covering.next() or covering.further()
        assert group
        outcome = run(group)
        covering.record(group, outcome)
        if outcome.verdict is Verdict.FAIL and len(group) == 1:
            found.append(({one.field for one in group[0].injections}, group[0].item.span))
    assert ({"f2", "f4"}, 1) in found
    assert ({"f3"}, 3) in found
    assert any("f5" in fields for fields, _ in found)
    assert covering.finished
    assert covering.covered == covering.total == 8 * 12


def test_faults_of_whole_messages_come_several_times_in_a_trial() -> None:
    """A unit survives one burst, and not the next."""
    places = log(2, 60)
    burst = Injection("t1", fault="duplicate", copies=20)
    covering = Covering([*items(2, 8, 12), Variation("t1", (burst,), "t1 duplicate")], places, seed=1)
    found = []
    for _ in range(300):
        group = covering.next() or covering.further()
        bursts = [one for each in group for one in each.injections if one.fault == "duplicate"]
        outcome = Outcome(Verdict.FAIL, (CRASH,), statistics={}) if len(bursts) > 1 else Outcome(Verdict.PASS)
        covering.record(group, outcome)
        found += [group[0]] if outcome.verdict is Verdict.FAIL and len(group) == 1 else []
    assert found
    assert all(2 <= len(set(each.firsts)) == each.item.times <= 4 for each in found)


def test_policies_on_many_messages_wait_until_all_of_a_topic_was_tried() -> None:
    places = log(2, 60) | {"one": [120]}
    every = [*items(2, 8, 12), *(Variation("one", (Injection("one", "g", n),), "g") for n in range(90))]
    covering = Covering(every, places, seed=2)
    tried: set[int] = set()
    drawn: set[str] = set()
    for _ in range(60):
        waiting = {each.topic for each in every if id(each) not in tried}
        policies = covering.policies()
        assert not {each.item.topic for each in policies} & waiting
        drawn |= {each.item.topic for each in policies}
        covering.stretches.record(policies, Outcome(Verdict.PASS))
        group = covering.next()
        tried |= {id(each.item) for each in group}
        covering.record(group, Outcome(Verdict.PASS))
    assert drawn == {"t0", "t1"}


def test_topics_of_one_message_hold_up_no_others() -> None:
    places = log(1, 200) | {"t1": [200]}
    every = [*items(1, 10, 10), *(Variation("t1", (Injection("t1", "g", n),), "g") for n in range(300))]
    asked = cover(Covering(every, places, seed=0), crash_on(lambda one: False, places))
    of_many = [
        at for at, group in enumerate(asked) if any(not each.item.again and each.item.topic == "t0" for each in group)
    ]
    assert max(of_many) < 20
    assert len(asked) == 300
    assert all(len(group) > 5 for group in asked[20:])


@settings(deadline=None)
@given(
    st.integers(1, 3),
    st.integers(1, 30),
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=4),
    st.integers(0, 40),
    st.integers(0, 5),
)
def test_nothing_is_forgotten_and_no_message_is_changed_twice(
    topics: int, messages: int, bad: list[tuple[int, int]], late: int, seed: int
) -> None:
    places = log(topics, messages)
    every = [*items(topics, 10, 4), Variation("t0", (Injection("t0", fault="drop"),), "drop", span=3, first=0)]
    wrong = {(f"f{field}", value) for field, value in bad}
    covering = Covering(every, places, seed=seed)
    run = crash_on(lambda one: (one.field, one.value) in wrong, places, late=late)
    for group in cover(covering, run):
        taken = [(each.item.topic, each.firsts[0] + at) for each in group for at in range(each.item.span)]
        assert len(set(taken)) == len(taken)
        assert all(number < messages for _, number in taken)
    assert covering.total == len(every) - (messages < 3)
    assert covering.covered <= covering.total
    if not wrong:
        assert covering.covered == covering.total
