import json
import random

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.inject.apply import inject_log
from riot_bus.inject.plan import plan_to_toml, read_plan
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Formula, Injection, Signal
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.predicate import parse_predicate

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
