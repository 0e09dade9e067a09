"""Which policies are drawn, with a dictionary of a test."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import chain
from typing import Any

import pytest

from riot_bus.campaign.schedule import Schedule, message_faults, positions_of
from riot_bus.campaign.targets import MOST_ADDED_BYTES, Target
from riot_bus.types.capabilities import SuggestedValue
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message

VALUES = {"int": (0, -1, 2**31 - 1), "text": ("", "x" * 1000), "none": ()}


class Values:
    """A dictionary that knows values by type, after those that the definition told."""

    def values_for(self, type_name: str, place: str, *, told: Sequence[SuggestedValue]) -> list[SuggestedValue]:
        return [*told, *(SuggestedValue(value, "") for value in VALUES[type_name])]


class Groups:
    """A mutation of five messages at most."""

    messages, most = 40, 5

    def injections(self, first: int, last: int, *, seed: int) -> list[Injection]:
        return [Injection("/plan", "mutated", None, first=first, last=last, seed=seed)]


ARRAY = [Target("/scan", f"ranges[{n}]", "int", 30, elements=("ranges[0]", "ranges[99]")) for n in range(4)]
TARGETS = {
    "/scan": [Target("/scan", "seq", "int", 30), *ARRAY],
    "/name": [Target("/name", "data", "text", 7), Target("/name", "raw", "none", 7)],
}


def schedule(seed: int = 0, **more: Any) -> Schedule:
    dictionary: Any = Values()
    return Schedule(TARGETS, dictionary, seed=seed, **more)


def drawn(trials: int = 300, **more: Any) -> list[Injection]:
    chosen = schedule(**more)
    return [each for trial in range(trials) for each in chosen.injections(trial)]


def test_seed_and_number_of_the_trial_alone_decide() -> None:
    one = schedule(seed=3)
    backwards = [one.injections(trial) for trial in range(50, -1, -1)]
    assert backwards[::-1] == [schedule(seed=3).injections(trial) for trial in range(51)]
    fields = [[str(each.field) for each in drawn(51, seed=seed)] for seed in (3, 4)]
    assert fields[0] != fields[1]


def test_each_value_of_each_field_is_drawn_within_its_log() -> None:
    found = drawn(400)
    expected = {(each.topic, each.path, value) for each in chain(*TARGETS.values()) for value in VALUES[each.type]}
    assert {(each.topic, each.field, each.value) for each in found} == expected
    for each in found:
        assert each.last is not None
        assert 0 <= each.first <= each.last < (30 if each.topic == "/scan" else 7)
    lengths = [each.last - each.first + 1 for each in found if each.topic == "/scan" and each.last is not None]
    assert min(lengths) == 1
    assert max(lengths) > 25
    assert sum(length <= 5 for length in lengths) > len(lengths) / 3  # short stretches are as usual as long ones


def test_an_array_weighs_as_much_as_one_field() -> None:
    fields = Counter(str(each.field)[:3] for each in drawn() if each.topic == "/scan")
    assert fields["ran"] == pytest.approx(fields["seq"], rel=0.15)


def test_mutations_change_no_more_messages_than_they_may() -> None:
    group: Any = Groups()
    found = drawn(groups={"/plan": {"long": [group]}, "/scan": {"wide": [group]}})
    mutated = [each for each in found if each.field == "mutated"]
    assert all(each.last is not None and each.last - each.first < 5 and each.last < 40 for each in mutated)
    assert {each.field for each in found} > {"mutated", "seq", "data"}
    assert schedule(groups={"/plan": {"long": [group]}}).items()[-1].most == 5


def test_each_value_is_an_item_once_for_a_whole_array() -> None:
    items = schedule().items()
    about = Counter(each.about for each in items)
    assert about == {"/scan:seq": 3, "/scan:ranges[*]": 3, "/name:data": 2}
    arrays = [each for each in items if each.about == "/scan:ranges[*]"]
    assert [each.injections[0].value for each in arrays] == list(VALUES["int"])
    assert all(each.injections[0].field in each.elements for each in arrays)
    assert [each.most for each in items if each.topic == "/name"] == [MOST_ADDED_BYTES, MOST_ADDED_BYTES // 1000]


def test_a_value_that_only_some_elements_take_stays_with_them() -> None:
    told = (SuggestedValue(66, "told"), SuggestedValue(77, "told"))
    odd = Target("/scan", "ranges[1]", "int", 30, told=told, elements=("ranges[0]", "ranges[99]"))
    dictionary: Any = Values()
    items = Schedule({"/scan": [ARRAY[0], odd]}, dictionary, seed=0).items()
    (item,) = (each for each in items if each.injections[0].value == 77)
    assert (item.injections[0].field, item.elements) == ("ranges[1]", ())


def test_a_log_without_fields_is_refused() -> None:
    dictionary: Any = Values()
    with pytest.raises(ConfigError, match="no field that can be injected"):
        Schedule({"/name": TARGETS["/name"][1:]}, dictionary, seed=0)


def test_faults_of_whole_messages_leave_topics_alone_that_must_not_change() -> None:
    messages = [Message(n * 10**8, key, b"{}") for n, key in enumerate("ab" * 20)]
    registry = TypeRegistry()
    assert positions_of(messages, registry) == {"a": list(range(0, 40, 2)), "b": list(range(1, 40, 2))}
    found = message_faults(messages, registry, leave=["b:**"])
    assert {each.topic for each in found} == {"a"}
    drops = [(each.span, each.first) for each in found if each.about == "a drop"]
    assert drops == [(1, None), (3, None), (5, 0), (1, 0)]
    assert {each.injections[0].copies for each in found if each.about == "a duplicate"} == {1, 20}
    assert {each.about for each in found if each.moves is not None} == {"a delay"}  # to be early, b would be late
    both = {(each.topic, each.about) for each in message_faults(messages, registry)}
    assert {("a", "a early"), ("b", "b early"), ("b", "b delay")} <= both
