import json
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from riot_bus.inject.apply import inject_log
from riot_bus.inject.plan import read_plan
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Formula, Injection, Signal
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.predicate import parse_predicate
from tests.plans import plan_to_toml
from tests.tiers import scaled

signals = st.builds(Signal, st.floats(-5, 5), st.floats(0, 5), st.integers(1, 4), st.integers(0, 9))
injections = st.lists(
    st.one_of(
        st.builds(
            Injection,
            topic=st.sampled_from(["a", "b", "*"]),
            field=st.just("x"),
            value=st.floats(allow_nan=False) | signals | st.just(Formula("n * 2.0 + x")),
            first=st.integers(0, 5),
            where=st.none() | st.just("n > 3"),
            probability=st.floats(0, 1),
        ),
        st.builds(
            Injection,
            topic=st.sampled_from(["a", "b"]),
            fault=st.sampled_from(["drop", "duplicate"]),
            probability=st.floats(0, 1),
            seed=st.integers(0, 5),
        ),
    ),
    max_size=4,
)


def streams(draw_a, draw_b):
    return [
        [Message(0, key, json.dumps({"x": 0.5, "n": n, "salt": salt}).encode()) for n, salt in enumerate(salts)]
        for key, salts in (("a", draw_a), ("b", draw_b))
    ]


salts = st.lists(st.integers(0, 3), max_size=12)


@settings(deadline=None)
@given(salts, salts, injections, st.integers(0, 100), st.randoms(use_true_random=False))
def test_same_seed_same_injections_whatever_the_order_across_topics(one, two, plan, seed, shuffle: random.Random):
    outcomes = []
    for _ in range(2):
        pending = [list(stream) for stream in streams(one, two)]
        merged = []
        while any(pending):
            merged.append(shuffle.choice([stream for stream in pending if stream]).pop(0))
        out, touched = inject_log(merged, plan, registry=TypeRegistry(), seed=seed)
        outcomes.append(
            {
                key: (
                    [message.payload for message in out if message.key == key],
                    [(original.payload, changes) for _, original, changes in touched if original.key == key],
                )
                for key in "ab"
            }
        )
    assert outcomes[0] == outcomes[1]


@settings(deadline=None)
@given(salts, salts, injections, st.integers(0, 100))
def test_untouched_messages_are_the_same_objects(one, two, plan, seed):
    messages = [message for stream in streams(one, two) for message in stream]
    out, touched = inject_log(messages, plan, registry=TypeRegistry(), seed=seed)
    hit = {index for index, _, _ in touched}
    delivered = {id(message) for message in out}
    assert all(id(message) in delivered for index, message in enumerate(messages) if index not in hit)


class OneTopic(TypeRegistry):
    """Keys have one topic, whose messages are counted together."""

    def topic(self, key):
        return "topic"


windows = st.builds(
    Injection,
    st.just("a"),
    fault=st.sampled_from(["delay", "drop"]),
    delay=st.sampled_from([1e-9, 9e-9]),
    start=st.sampled_from([0.0, 3e-9]),
    first=st.integers(0, 5),
)
logs = st.lists(
    st.builds(
        lambda time, key, n: Message(time, key, json.dumps({"x": 0.5, "n": n}).encode()),
        st.integers(0, 9),
        st.sampled_from("abc"),
        st.integers(0, 6),
    ),
    max_size=20,
)


LOG = [Message(time, key, b'{"x": 0.5, "n": 1}') for time, key in enumerate("cccaaa")]


@settings(deadline=None, max_examples=scaled(400))
@example(LOG, [], [Injection("a", fault="drop", first=4)], 0, OneTopic)
@example(LOG, [], [Injection("a", fault="delay", delay=1e-9, start=4e-9)], 0, TypeRegistry)
@given(logs, injections, st.lists(windows, max_size=2), st.integers(0, 9), st.sampled_from([TypeRegistry, OneTopic]))
def test_messages_that_no_injection_wants_are_as_if_they_were_looked_at(log, plan, more, seed, registry):
    def injected():
        reached, ahead = [], []
        found = inject_log(log, plan + more, registry=registry(), seed=seed, reached=reached, ahead=ahead)
        return found, reached, ahead

    fast = injected()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Pipeline, "passes", lambda self, message: False)
        assert injected() == fast


@settings(deadline=None)
@given(injections, st.text(st.characters(exclude_categories=["Cs"]), max_size=20))
def test_plans_survive_being_written(tmp_path_factory, plan, text):
    path = tmp_path_factory.getbasetemp() / "plan.toml"
    plan = [*plan, Injection("t", "x", text)]
    path.write_text(plan_to_toml(plan), encoding="utf-8")
    assert read_plan(path) == tuple(plan)


@settings(deadline=None)
@given(st.text("ab12.=<>!() \"'andortrue[]", max_size=25))
def test_any_text_is_a_predicate_or_a_config_error(text):
    try:
        predicate = parse_predicate(text)
    except ConfigError as error:
        place = error.where
    else:
        place = None
        assert predicate.fields
    assert place is None or place.startswith("predicate, column ")
