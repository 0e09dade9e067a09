"""What a selector means in a trial, and why it means nothing."""

from __future__ import annotations

import pytest

from riot_bus.monitors.selection import field_selector, message_selector, numbers, selected, why_unseen
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_testkit.monitors import trial_view

VIEW = trial_view([("a/b", {"x": 1}), ("a/c", {"x": True, "y": "t"}), ("a/b", {"x": 2.5})], inputs=[("in", {"x": 7})])


def test_numbers_and_messages_of_outputs_or_others() -> None:
    assert list(numbers(VIEW, field_selector("a/*:x"))) == [1, 1, 2.5]
    assert len(list(selected(VIEW, message_selector("a/b where x > 2")))) == 1
    assert len(list(selected(VIEW, message_selector("in"), VIEW.inputs))) == 1
    with pytest.raises(PayloadError, match="is unknown"):
        list(selected(trial_view([("a", b"\xff\x00")]), message_selector("a")))


@pytest.mark.parametrize(
    ("text", "why"), [("a/c:y", "is not a number"), ("a/b where x > 9", "none meets"), ("b", "no message")]
)
def test_why_nothing_is_selected(text: str, why: str) -> None:
    selector = field_selector(text) if ":" in text else message_selector(text)
    assert why in (why_unseen(VIEW, selector) or "")


def test_a_condition_need_not_be_met_where_only_its_fields_are_asked_for() -> None:
    assert why_unseen(VIEW, message_selector("a/b where x > 9"), met=False) is None
    assert why_unseen(VIEW, message_selector("a/b where z > 9"), met=False) is not None
    assert why_unseen(VIEW, field_selector("a/b:x")) is None


def test_texts_that_are_no_selectors_are_refused() -> None:
    with pytest.raises(ConfigError):
        message_selector("a:x")
    with pytest.raises(ConfigError):
        field_selector("a")
