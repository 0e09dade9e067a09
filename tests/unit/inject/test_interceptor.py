import json
import logging
import math
import struct

import pytest

from riot_bus.inject.apply import inject_log
from riot_bus.inject.interceptor import Injector
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.injection import Injection, Signal
from riot_bus.vocabulary.message import Message

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


@pytest.mark.parametrize(
    ("field", "document", "problem"),
    [
        ("w[*]", {}, "no field 'w'"),
        ("x[*]", {}, "only arrays have a length"),
        ("v[*].x", {}, "no field 'x'"),
        ("a[*].typo", {"a": [{"b": 1}]}, "no field 'typo'"),
        ("a[*].b[*]", {"a": [{"c": 1}]}, "no field 'b'"),
        ("v[*]", {"v": [None]}, "null is not a scalar field"),
    ],
)
def test_star_on_fields_that_are_not_there(field, document, problem):
    pipeline = Pipeline([injector := Injector([Injection("a", field, 5.5)])], registry=TypeRegistry())
    (message,) = log(1, **document)
    assert pipeline.feed(message).emissions[0].message is message
    assert injector.skipped["a"] == 1
    assert problem in str(injector.problems["a"])


@pytest.mark.parametrize(("field", "document"), [("v[*]", {"v": []}), ("a[*].b[*].c", {"a": [{"b": []}]})])
def test_star_on_empty_arrays(field, document):
    out, _ = run(log(1, **document), Injection("a", field, 5.5))
    assert out[0].payload == log(1, **document)[0].payload


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


VECTOR = struct.Struct("<4s3d")
VECTORS = TypeRegistry(load_adapters(["ros2"]), declared={"v": "geometry_msgs/msg/Vector3"})


def vector(x, y=2.0):
    return VECTOR.pack(b"\0\1\0\0", x, y, 3.0)


def test_what_changes_the_payload_alone_needs_no_events():
    injectors = [
        Injector([Injection("v", "x", "nan")]),
        Injector([Injection("other", "x", 5.0), Injection("v", "y", 7)]),
    ]
    pipelines = [Pipeline(injectors, registry=VECTORS, provenance=False) for _ in range(2)]
    for each in pipelines:
        each.start()
    rewrite = pipelines[0].rewriter("v", vector(0.0))
    for payload in (vector(1.0), vector(-1.0) + b"more", vector(math.inf)):
        (emission,) = pipelines[1].feed(Message(0, "v", payload)).emissions
        assert rewrite(payload) == emission.message.payload
        assert VECTOR.unpack_from(rewrite(payload))[2:] == (7.0, 3.0)
    with pytest.raises(PayloadError):
        rewrite(b"\0\1\0\0short")
    for injector in injectors:
        injector.hits.clear()
    pipelines[0].rewrote("v", 5)
    assert (injectors[0].hits, injectors[1].hits) == ({0: 5}, {1: 5})
    counts = pipelines[0].counts["v"]
    assert (counts.seen, counts.changed, counts.delivered, counts.dropped) == (5, 5, 5, 0)


@pytest.mark.parametrize(
    ("others", "options"),
    [
        ([Injection("v", "x", 1.0, first=2)], {}),
        ([Injection("v", "x", 1.0, where="y > 0")], {}),
        ([Injection("v", "x", 1.0, probability=0.5)], {}),
        ([Injection("v", "x", Signal(0.0, 1.0))], {}),
        ([Injection("v", fault="drop")], {}),
        ([Injection("v", "nothing", 1.0)], {}),
        ([Injection("v", "x", 1.0), Injection("v", "y", 1.0)], {}),
        ([Injection("v", "x", 1.0)], {"provenance": True}),
        ([], {}),
    ],
)
def test_what_needs_more_than_the_payload_needs_events(others, options):
    pipeline = Pipeline([Injector(others)], registry=VECTORS, **{"provenance": False, **options})
    pipeline.start()
    assert pipeline.rewriter("v", vector(0.0)) is None


def test_conditions_and_other_interceptors_need_events():
    injector = Injector([Injection("v", "x", 1.0)])
    for given in ([Selective(injector, When(target="unit"))], [Selective(injector, When(last=5))], [injector, Looks()]):
        pipeline = Pipeline(given, registry=VECTORS, provenance=False)
        assert pipeline.rewriter("v", vector(0.0)) is None  # nobody has started it
        pipeline.start()
        assert pipeline.rewriter("v", vector(0.0)) is None


class Looks:
    def message(self, event):
        pass
