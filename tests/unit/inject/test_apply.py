import json
from dataclasses import replace

import pytest

from riot_bus.inject import apply
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import RiotError
from riot_bus.vocabulary.injection import Curve, Injection, Signal
from riot_bus.vocabulary.message import Message


def test_nothing_to_inject_gives_the_log_back():
    messages = [Message(n, "a", b"{}") for n in range(5)]
    assert apply.inject_log(messages, [], registry=TypeRegistry()) == (tuple(messages), [])


def test_delayed_past_the_end_still_arrives():
    out, _ = apply.inject_log(
        [Message(5, "a", b"{}")], [Injection("a", fault="delay", delay=60)], registry=TypeRegistry()
    )
    assert [message.time for message in out] == [60 * 10**9 + 5]


def test_a_bug_of_ours_is_not_hidden(monkeypatch):
    monkeypatch.setattr(apply.Injector, "message", lambda self, event: 1 / 0)
    with pytest.raises(RiotError, match="ZeroDivisionError"):
        apply.inject_log([Message(5, "a", b"{}")], [Injection("a", fault="drop")], registry=TypeRegistry())


def test_which_messages_each_injection_changed() -> None:
    log = [Message(number, "a", json.dumps({"x": number, "y": 7}).encode()) for number in range(4)]
    injections = [
        Injection("a", "x", 2),
        Injection("a", "y", 7),  # what it is already
        Injection("a", "missing", 1),
        Injection("b", "x", 1),
        Injection("a", fault="drop", first=3),
    ]
    reached: list[list[int]] = []
    apply.inject_log(log, injections, registry=TypeRegistry(), reached=reached)
    assert reached == [[0, 1, 3], [], [], [], [3]]


def test_messages_of_keys_without_injections_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    fed: list[Message] = []
    feed = Pipeline.feed
    monkeypatch.setattr(Pipeline, "feed", lambda self, message: fed.append(message) or feed(self, message))
    log = [Message(number, "ab"[number % 2], b"{}") for number in range(10)]
    out, _ = apply.inject_log(log, [Injection("a", fault="drop", last=1)], registry=TypeRegistry())
    assert (list(out), fed) == ([log[1], *log[3:]], log[::2])


def test_how_much_comes_out_before_the_turn_of_each_message() -> None:
    log = [Message(number, "a", b"{}") for number in range(5)]
    faults = [Injection("a", fault="drop", last=1), Injection("a", fault="duplicate", copies=2, first=2, last=2)]
    ahead: list[int] = []
    out, _ = apply.inject_log(log, faults, registry=TypeRegistry(), ahead=ahead)
    assert (ahead, len(out)) == ([0, 0, 0, 3, 4], 5)


def test_a_signal_of_whole_numbers_sets_a_boolean() -> None:
    log = [Message(10**18 + number, "a", b'{"on": true}', encoding="application/json") for number in range(40)]
    signal = Signal(0.5, 0.5, hold=1, seed=3, integer=True)
    changed, _ = apply.inject_log(log, [Injection("a", "on", signal)], registry=TypeRegistry())
    assert {message.payload for message in changed} == {b'{"on": true}', b'{"on": false}'}
    assert [message.payload == b'{"on": true}' for message in changed] == [signal.value(n) == 1.0 for n in range(40)]


def test_a_curve_goes_along_lines_over_the_time_of_the_log():
    log = [Message(10**18 + at * 500_000_000, "v", json.dumps({"x": 0.5, "n": 1}).encode()) for at in range(7)]
    curve = Curve((0.5, 1.5, 2.5), (2.0, 10.0, 0.0))
    injections = [Injection("v", "x", curve), Injection("v", "n", replace(curve, integer=True))]
    messages, _ = apply.inject_log(log, injections, registry=TypeRegistry())
    values = [json.loads(message.payload) for message in messages]
    assert [one["x"] for one in values] == [2.0, 2.0, 6.0, 10.0, 5.0, 0.0, 0.0]
    assert [one["n"] for one in values] == [2, 2, 6, 10, 5, 0, 0]


def test_a_signal_chooses_among_values_of_any_type():
    log = [Message(10**18 + at, "v", b'{"mode": "idle"}') for at in range(60)]
    signal = Signal(1.0, 1.499, hold=1, seed=3, integer=True, choices=("idle", "run", "stop"))
    messages, _ = apply.inject_log(log, [Injection("v", "mode", signal)], registry=TypeRegistry())
    modes = [json.loads(message.payload)["mode"] for message in messages]
    assert set(modes) == {"idle", "run", "stop"}
    assert [signal.choices[int(signal.value(at))] for at in range(60)] == modes
    assert "choices" not in Injection("v", "n", Signal(1.0, 1.0)).row()["value"]  # digests of older plans hold
