from __future__ import annotations

from riot_bus.campaign.variations import Placed, Variation, sets_value
from riot_bus.vocabulary.injection import Injection


def test_a_thing_changes_the_messages_that_it_is_placed_on_each_time() -> None:
    item = Variation("t", (Injection("t", "a", 1), Injection("t", "b", 2)), "a and b", span=3, times=2)
    assert [(each.field, each.first, each.last) for each in Placed(item, (4, 10)).injections] == [
        ("a", 4, 6),
        ("b", 4, 6),
        ("a", 10, 12),
        ("b", 10, 12),
    ]


def test_a_window_of_time_says_itself_which_messages_it_means() -> None:
    injection = Injection("t", "a", 1, start=0.5, end=1.5)
    assert Placed(Variation("t", (injection,), "a", span=7), (3,)).injections == [injection]


def test_lengths_and_faults_are_no_values_for_other_fields() -> None:
    kinds = (Injection("t", "a", 1), Injection("t", "len(a)", 1), Injection("t", fault="drop"))
    assert [sets_value(Variation("t", (each,), "a")) for each in kinds] == [True, False, False]
