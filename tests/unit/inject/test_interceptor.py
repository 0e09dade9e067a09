import json
import logging
import math

import pytest

from riot_bus.errors import ConfigError
from riot_bus.inject.apply import inject_log
from riot_bus.inject.interceptor import Injector
from riot_bus.injection import Injection, Signal
from riot_bus.message import Message
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry

SECOND = 10**9


def log(count=10, key="a", **fields):
    return [
        Message(
            SECOND * (n + 1),
            key,
            json.dumps({"x": float(n), "n": n, "on": False, "s": "t", "v": [1.0, 2.0], **fields}).encode(),
        )
        for n in range(count)
    ]


def run(messages, *injections, seed=0):
    return inject_log(messages, injections, registry=TypeRegistry(), seed=seed)


def values(messages, field="x"):
    return [json.loads(message.payload)[field] for message in messages]


def test_set_in_a_time_window_and_by_index():
    out, touched = run(log(), Injection("a", "x", -1.5, start=2.0, end=4.0), Injection("a", "x", 99.5, first=8, last=8))
    assert values(out) == [0, 1, -1.5, -1.5, 4, 5, 6, 7, 99.5, 9]
    assert [index for index, _, _ in touched] == [2, 3, 8]
    assert touched[0][2][0].before == 2.0


def test_where_selects():
    out, _ = run(log(), Injection("a", "x", -1.5, where="n >= 8 or x == 3"))
    assert [n for n, x in enumerate(values(out)) if x == -1.5] == [3, 8, 9]


def test_untouched_messages_are_the_same_objects():
    messages = log()
    out, _ = run(messages, Injection("a", "x", 1.5, first=3, last=3))
    assert all(one is two for n, (one, two) in enumerate(zip(out, messages, strict=True)) if n != 3)


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [("x", "-inf", -math.inf), ("x", 2, 2.0), ("n", 7.0, 7), ("s", "nan", "nan"), ("on", 1, True)],
)
def test_values_are_fitted_to_the_field(field, value, expected):
    out, touched = run(log(1), Injection("a", field, value))
    assert touched[0][2][0].after == expected
    assert type(touched[0][2][0].after) is type(expected)
    assert out[0].payload != log(1)[0].payload


def test_star_sets_every_element_with_one_change():
    out, touched = run(log(1), Injection("a", "v[*]", 5.5))
    assert values(out, "v") == [[5.5, 5.5]]
    assert len(touched[0][2]) == 1


def test_timing_faults():
    out, _ = run(
        log(4),
        Injection("a", fault="drop", first=0, last=0),
        Injection("a", fault="delay", delay=1.5, first=1, last=1),
        Injection("a", fault="duplicate", copies=2, first=3),
    )
    assert [(message.time / SECOND, json.loads(message.payload)["n"]) for message in out] == [
        (3.0, 2),
        (3.5, 1),
        (4.0, 3),
        (4.0, 3),
        (4.0, 3),
    ]


def test_signal_follows_the_index():
    signal = Signal(10.0, 2.0, hold=3, seed=4)
    out, _ = run(log(6), Injection("a", "x", signal))
    assert values(out) == [signal.value(n) for n in range(6)]


def test_probability_depends_on_seed_alone():
    chosen = [
        [index for index, _, _ in run(log(200), Injection("a", fault="drop", probability=0.3), seed=s)[1]]
        for s in (1, 1, 2)
    ]
    assert chosen[0] == chosen[1] != chosen[2]
    assert 30 < len(chosen[0]) < 90


def test_an_earlier_injection_does_not_sway_the_choice_of_a_later_one():
    choice = Injection("a", fault="duplicate", probability=0.5)
    alone = [i for i, _, _ in run(log(100), Injection("b", "x", 1.5), choice)[1]]
    both = [i for i, _, c in run(log(100), Injection("a", "x", 1.5), choice)[1] if len(c) == 2]
    assert alone == both


def test_what_does_not_decode_passes_is_counted_and_reported_once(caplog):
    injector = Injector([Injection("a", "x", 1.5), Injection("a", "missing", 1.5)])
    pipeline = Pipeline([injector], registry=TypeRegistry())
    broken = Message(SECOND, "a", b"\xff\x00garbage")
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            assert pipeline.feed(broken).emissions[0].message is broken
    assert injector.skipped["a"] == 6
    assert len(caplog.records) == 1
    assert list(injector.problems) == ["a"]
    assert pipeline.errors == {}


def test_hits_are_counted():
    injector = Injector([Injection("a", "x", 1.5, last=2), Injection("b", fault="drop")])
    pipeline = Pipeline([injector], registry=TypeRegistry())
    for message in log():
        pipeline.feed(message)
    assert injector.hits == {0: 3}


def test_an_injection_that_sets_nothing_is_refused():
    with pytest.raises(ConfigError, match="sets nothing"):
        Injector([Injection("a", "x")])


def test_provenance_says_what_the_field_holds_now():
    out, touched = run(log(1), Injection("a", "n", 2**64 + 5))
    assert touched[0][2][0].after == values(out, "n")[0] != 2**64 + 5
