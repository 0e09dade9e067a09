from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from riot_bus.chain.base.logs import FailingLog, NamedFields
from riot_bus.chain.unit.simplify import Simplification, rungs_of, spaced
from riot_bus.statistics.noise import Noise
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Scalar

REGISTRY = TypeRegistry()
START = 10**18


def message(number: int, key: str = "cmd", *, at: float | None = None, **values: Any) -> Message:
    return Message(START + int((number if at is None else at) * 1e9), key, json.dumps(values).encode(), sequence=number)


def simplified(
    log: FailingLog,
    fails: Callable[[Sequence[Message]], bool],
    *,
    paced: bool = False,
    observed: Sequence[Scalar] = (),
    budget: int = 500,
) -> Simplification:
    assert fails(log.messages)
    told: list[FailingLog] = []

    def values(fields: NamedFields) -> dict[str, Sequence[Scalar]]:
        return dict.fromkeys(fields.fields, observed)

    work = Simplification(
        log,
        lambda logs: [fails(each.messages) for each in logs],
        registry=REGISTRY,
        paced=paced,
        observed=values,
        better=told.append,
    )
    work.run(noise=Noise.after(4, 4, nominal_total=4), budget=budget, parallelism=1, progress=None)
    assert fails(work.log.messages)
    assert not told or told[-1] == work.log
    return work


def said(log: FailingLog, place: int = 0) -> Any:
    return json.loads(log.messages[place].payload)


def test_fields_that_do_not_matter_are_nominal_again_and_the_rest_has_simple_values() -> None:
    log = FailingLog((message(7, x=-2147483648, y=91, note="A" * 300),), {7: message(7, x=3, y=5, note="hello")})
    work = simplified(log, lambda messages: json.loads(messages[0].payload)["x"] < -1000)
    assert said(work.log) == {"x": -10000, "y": 5, "note": "hello"}
    assert list(work.log.originals) == [7]
    assert [(one.what, one.name, one.before, one.after) for one in work.records] == [
        ("value", "cmd:x", -2147483648, -10000),
        ("nominal", "cmd:y", 91, 5),
        ("nominal", "cmd:note", "A" * 300, "hello"),
    ]
    assert str(work.records[0]) == "cmd:x: -2147483648 -> -10000"
    assert str(work.records[2]).endswith('... (302 characters) -> "hello" (nominal)')


def test_messages_whose_modification_does_not_matter_are_not_modified_any_more() -> None:
    log = FailingLog(
        (message(1, x=-5), message(2, x=999999), message(3, x=-7)),
        {number: message(number, x=1) for number in (1, 2, 3)},
    )

    def fails(messages: Sequence[Message]) -> bool:
        return len(messages) == 3 and json.loads(messages[1].payload)["x"] > 100

    work = simplified(log, fails)
    assert [said(work.log, place)["x"] for place in range(3)] == [1, 1000, 1]
    assert list(work.log.originals) == [2]
    assert {one.name for one in work.records} == {"cmd[0]", "cmd[1]:x", "cmd[2]"}


def test_what_fields_do_not_tell_goes_back_as_a_whole_or_stays() -> None:
    cut = message(4, x=1).with_(payload=b'{"x": ')
    log = FailingLog((cut, message(5, x=2)), {4: message(4, x=1)})
    assert simplified(log, lambda messages: len(messages) == 2).log.messages[0].payload == message(4, x=1).payload
    assert simplified(log, lambda messages: messages[0].payload.endswith(b" ")).log == log


def test_gaps_are_as_short_as_they_can_be_where_they_decide() -> None:
    log = FailingLog(
        (message(0, at=0, x=1), message(1, at=40, x=-9), message(2, at=47.5, x=3)), {1: message(1, at=40, x=0)}
    )

    def fails(messages: Sequence[Message]) -> bool:
        return messages[2].time - messages[1].time > 0.3e9 and json.loads(messages[1].payload)["x"] < 0

    work = simplified(log, fails, paced=True)
    assert [one.time - START for one in work.log.messages] == [0, 0, 500_000_000]
    assert work.log.originals[1].time == START  # it moves with what was made of it
    assert [str(one) for one in work.records if one.what == "gap"] == [
        "cmd[0] to cmd[1]: 40 s -> 0 s",
        "cmd[1] to cmd[2]: 7.5 s -> 0.5 s; shorter times that were tried pass",
    ]


def test_times_are_not_asked_where_they_play_no_part() -> None:
    log = FailingLog((message(0, x=1), message(9, x=2)), {})
    work = simplified(log, lambda messages: True)
    assert work.log == log
    assert work.trials == 0
    near = spaced(log, [1_000_000])
    assert [one.time - START for one in near.messages] == [0, 1_000_000]
    assert [one.payload for one in near.messages] == [one.payload for one in log.messages]


def test_a_delayed_message_stays_modified() -> None:
    late = message(1, at=5, x=1)
    log = FailingLog((message(2, at=2, x=-30), late), {1: message(1, at=1, x=1), 2: message(2, at=2, x=4)})
    work = simplified(log, lambda messages: messages[0].sequence == 2 and messages[1].sequence == 1)
    assert said(work.log)["x"] == 4
    assert list(work.log.originals) == [1]


def test_values_of_nominal_messages_explain_nothing() -> None:
    log = FailingLog((message(0, x=-700),), {0: message(0, x=5)})
    assert said(simplified(log, lambda messages: said(FailingLog(tuple(messages), {}))["x"] < 5).log) == {"x": 0}
    seen = simplified(log, lambda messages: said(FailingLog(tuple(messages), {}))["x"] < 5, observed=[0, -1, 9])
    assert said(seen.log) == {"x": -10}


def test_a_budget_that_ends_leaves_what_fails() -> None:
    log = FailingLog((message(0, x=-70000, y=3),), {0: message(0, x=5, y=4)})
    for budget in range(8):
        work = simplified(log, lambda messages: json.loads(messages[0].payload)["x"] < -50, budget=budget)
        assert work.trials <= budget


@pytest.mark.parametrize(
    ("kind", "value", "nominal", "rungs"),
    [
        ("int32", -150, 4, (4, 0, -1, -10, -100, -200, -2147483648, -150)),
        ("uint8", 200, 4, (4, 0, 1, 10, 100, 255, 200)),
        ("uint8", 250, 4, (4, 0, 1, 10, 100, 255, 250)),
        ("int8", -128, 0, (0, -1, -10, -100, -128)),
        ("float64", 0.25, 4.0, (4.0, 0.0, 1.0, 0.25)),
        ("float64", 33.5, 4.0, (4.0, 0.0, 1.0, 10.0, 40.0, 33.5)),
        ("bool", True, False, (False, True)),
        ("string", "abcde", "x", ("x", "", "a", "ab", "abcd", "abcde")),
        ("bytes", b"abc", b"", (b"", b"a", b"ab", b"abc")),
    ],
)
def test_the_simplest_values_come_first(kind: str, value: Scalar, nominal: Scalar, rungs: tuple[Scalar, ...]) -> None:
    assert rungs_of("x", kind, value, nominal) == rungs


def test_lengths_and_numbers_that_are_none() -> None:
    assert rungs_of("len(data)", "uint16", 1000, 20) == (20, 32, 64, 128, 256, 512, 1000)
    assert rungs_of("len(data)", "uint16", 0, 20) == (20, 0)
    assert len(rungs_of("x", "float64", float("nan"), 1.5)) == 2
    *simple, last = rungs_of("x", "float32", float("-inf"), 1.5)
    assert last == float("-inf")
    assert simple[:4] == [1.5, 0.0, -1.0, -10.0]
    assert simple[-1] == -1e37
