"""Policies on many messages: which there are, and that what fails is found alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from riot_bus.campaign.stretches import Stretches
from riot_bus.campaign.variations import Placed, Variation
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, Verdict

COUNT = 60
TOPICS = ("a", "b", "c")
POSITIONS = {topic: list(range(at, 3 * COUNT, 3)) for at, topic in enumerate(TOPICS)}
Run = Callable[[Sequence[Placed]], Outcome]


def stretches(*more: Variation, seed: int = 0) -> Stretches:
    found = Stretches(POSITIONS, seed=seed)
    for topic in TOPICS:
        for field in range(4):
            for value in range(5):
                found.add(Variation(topic, (Injection(topic, f"f{field}", value),), f"{topic}:f{field}"))
        found.add(Variation(topic, (Injection(topic, fault="drop"),), f"{topic} drop"))
        found.add(Variation(topic, (Injection(topic, fault="duplicate", copies=20),), f"{topic} duplicate"))
    for item in more:
        found.add(item)
    return found


def passes(_: Sequence[Placed]) -> Outcome:
    return Outcome(Verdict.PASS, statistics={"outputs": 100})


def asked(
    chooser: Stretches, run: Run = passes, trials: int = 200, topics: Sequence[str] = TOPICS
) -> list[Sequence[Placed]]:
    found = []
    for _ in range(trials):
        group = chooser.next(topics)
        chooser.record(group, run(group))
        found.append(group)
    return found


def placed(groups: Sequence[Sequence[Placed]]) -> list[Placed]:
    return [one for group in groups for one in group]


def test_all_kinds_of_policies_are_drawn() -> None:
    found = [one for each in placed(asked(stretches())) for one in each.injections]
    assert {one.probability for one in found} == {0.1, 0.3, 0.5, 1.0}
    assert len({one.seed for one in found if one.probability < 1}) > 20
    assert {one.fault for one in found} == {"set", "drop"}  # a burst on four messages would be more than all others
    assert any(len(each.injections) == 2 for each in placed(asked(stretches())))


def test_windows_lie_in_the_log_and_a_topic_has_one_policy_in_a_trial() -> None:
    for group in asked(stretches(seed=3)):
        assert len({each.item.topic for each in group}) == len(group)
        for each in group:
            assert each.item.again
            assert 0 <= each.firsts[0] <= each.firsts[0] + each.item.span - 1 < COUNT
            assert each.item.span >= 4
    assert max(map(len, asked(stretches()))) == len(TOPICS)


def test_only_topics_that_are_asked_for() -> None:
    assert {each.item.topic for each in placed(asked(stretches(), topics=["b", "unknown"]))} == {"b"}
    assert stretches().next([]) == ()


def test_what_grows_is_not_put_on_more_messages_than_it_may() -> None:
    large = Variation("a", (Injection("a", "f9", "A" * 9),), "a:f9", most=6)
    huge = replace(large, injections=(Injection("a", "f8", "A" * 9),), about="a:f8", most=2)
    found = [each for each in placed(asked(stretches(large, huge), trials=600)) if each.item.most]
    assert found
    assert {each.item.span for each in found} <= {4, 5, 6}
    assert not any(one.field == "f8" for each in found for one in each.injections)


def test_what_fails_is_found_alone_and_then_no_more() -> None:
    def bad(each: Placed) -> bool:
        return each.item.span >= 10 and any(one.field == "f2" and one.topic == "b" for one in each.injections)

    def run(group: Sequence[Placed]) -> Outcome:
        return Outcome(Verdict.FAIL) if any(map(bad, group)) else passes(group)

    groups = asked(stretches(), run, trials=400)
    alone = [
        at for at, group in enumerate(groups) if len(group) == 1 and bad(group[0]) and group[0].item.about == "b:f2"
    ]
    assert len(alone) == 3
    later = placed(groups[alone[-1] + 1 :])
    assert not any(each.item.about == "b:f2" for each in later)
    assert any(each.item.about == "b:f1" for each in later)


def test_the_same_answers_give_the_same_choices() -> None:
    one, other = (asked(stretches(seed=5)) for _ in range(2))
    assert one == other
    assert one != asked(stretches(seed=6))


def test_topics_of_few_messages_have_no_stretches() -> None:
    chooser = Stretches({"a": [0, 1, 2]}, seed=0)
    chooser.add(Variation("a", (Injection("a", "f", 1),), "a:f"))
    assert chooser.next(["a"]) == ()
