from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.monitors.arrivals import Never
from riot_bus.monitors.exchanges import Answered
from riot_bus.monitors.invariants import Gapless, Values
from riot_bus.monitors.model import ComponentView, TrialView, judge
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

SECOND = 10**9


def view(*outputs: tuple[float, str, object], end: float = 100.0) -> TrialView:
    messages = [Message(round(time * SECOND), key, json.dumps(value).encode()) for time, key, value in outputs]
    component = ComponentView("part", None, "", Path("/x"))
    return TrialView([component], True, 2.0, TypeRegistry(), messages, 0, round(end * SECOND))


def test_never_tells_the_first_message_that_meets_the_condition() -> None:
    monitor = Never("a/text where level <= 2", tell="text")
    assert monitor.topics == ("a/text",)
    calm, urgent = {"level": 3, "text": "hm"}, {"level": 2, "text": "fire"}
    assert monitor.judge(view((1, "a/text", calm), (2, "b/text", urgent))) == []
    (found,) = monitor.judge(view((1, "a/text", calm), (2, "a/text", urgent), (3, "a/text", {"level": 0, "text": "x"})))
    assert found.signature == "never a/text where level <= 2"
    assert found.detail == "a/text: text = 'fire'"
    assert Never("a/text").judge(view((1, "a/text", calm))) != []


def test_values_of_some_bits() -> None:
    armed = Values("a:mode", allowed=[0], mask=0x80)
    assert armed.judge(view((1, "a", {"mode": 0x51}))) == []
    (found,) = armed.judge(view((1, "a", {"mode": 0x51}), (2, "a", {"mode": 0xD1})))
    assert found.signature == "values of a:mode"
    assert Values("a:mode", allowed=[1, 2]).judge(view((1, "a", {"mode": 2}))) == []
    assert Values("a:mode", allowed=[1, 2]).judge(view((1, "a", {"mode": 3}))) != []


def test_sequence_numbers_wrap_and_have_no_gaps() -> None:
    def numbers(*values: int) -> TrialView:
        return view(*[(time, f"link/{time % 2}", {"n": value}) for time, value in enumerate(values)])

    assert Gapless("link/*:n").judge(numbers(254, 255, 0, 1)) == []
    (found,) = Gapless("link/*:n").judge(numbers(254, 255, 1, 2, 5))
    assert found.detail == "3 lost, 5 received (allowed: 0)"
    assert Gapless("link/*:n", lost=3).judge(numbers(254, 255, 1, 2, 5)) == []
    assert Gapless("link/*:n", modulo=10).judge(numbers(8, 9, 0)) == []
    assert Gapless("link/*:n").judge(view()) == []


def test_requests_without_an_answer() -> None:
    monitor = Answered("ask", answer="tell where ok == true", within=1.0, same=["id"])
    assert monitor.topics == ("ask", "tell")
    first, second = (1.0, "ask", {"id": 7}), (2.0, "ask", {"id": 8})
    assert monitor.judge(view(first, (1.9, "tell", {"id": 7, "ok": True}))) == []
    late, denied, other = (
        (when, "tell", {"id": i, "ok": ok}) for when, i, ok in ((2.1, 7, 1), (1.5, 7, 0), (1.5, 8, 1))
    )
    for answer in (late, denied, other):
        (found,) = monitor.judge(view(first, answer))
        assert found.signature == "answer to ask"
        assert "id = 7" in found.detail
    assert monitor.judge(view(first, (1.2, "tell", {"id": 7, "ok": True}), second, end=2.5)) == []
    assert monitor.judge(view(first, (1.2, "tell", {"id": 7, "ok": True}), second)) != []


def test_wrong_selectors_are_refused() -> None:
    for wrong in (
        lambda: Never("a:field where x == 1"),
        lambda: Never("a where x ="),
        lambda: Values("a", allowed=[1]),
        lambda: Gapless("a"),
        lambda: Answered("a:b", answer="c", within=1.0),
    ):
        with pytest.raises(ConfigError):
            wrong()


def test_a_field_that_is_no_integer_is_told() -> None:
    judged = judge(view((1, "a", {"x": "text"})), [Values("a:x", allowed=[1]), Gapless("a:x")])
    assert [line.partition(": ")[2] for line in judged.unseen] == ["of 1 messages of 'a': 'x' is not a number"] * 2
    mixed = judge(view((1, "a", {"x": 1}), (2, "a", {"x": 1.5})), [Values("a:x", allowed=[1]), Gapless("a:x")])
    assert len(mixed.broken) == 2


def test_a_request_that_was_an_input_is_known_too() -> None:
    monitor = Answered("ask", answer="tell", within=1.0)
    asked = replace(view((1.5, "tell", {})), inputs=[Message(SECOND, "ask", b"{}")])
    assert monitor.judge(asked) == []
    assert monitor.judge(replace(asked, outputs=[])) != []


def test_the_time_to_answer_counts_from_the_first_input() -> None:
    monitor = Answered("ask", answer="tell", within=1.0)
    early = view((1, "ask", {}), (5.5, "tell", {}))
    assert monitor.judge(early) != []
    assert monitor.judge(replace(early, inputs=[Message(5 * SECOND, "in", b"{}")])) == []


def test_a_busy_machine_has_as_much_more_time_to_answer() -> None:
    monitor, late = Answered("ask", answer="tell", within=1.0), view((1, "ask", {}), (2.5, "tell", {}), end=10.0)
    assert monitor.judge(late) != []
    assert monitor.judge(replace(late, held_up=1.0)) == []
    assert monitor.judge(replace(late, held_up=0.4)) != []
    assert monitor.judge(replace(view((1, "ask", {}), end=10.0), held_up=1.0)) != []
