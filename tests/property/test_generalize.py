import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.generalize.features import FEATURE_KINDS, FLAGS, Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.numbers import between, simplest
from riot_bus.generalize.oracle import same_scalar
from riot_bus.generalize.relevance import FieldSpace, relevant_fields
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Scalar
from tests.tiers import scaled

NUMBERS = st.one_of(st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False, allow_infinity=False))


@settings(max_examples=scaled(80), deadline=None)
@given(
    st.integers(1, 40).flatmap(
        lambda n: st.tuples(st.just(n), st.lists(st.frozensets(st.integers(0, n - 1)), min_size=1, max_size=4))
    ),
    st.integers(1, 5),
)
def test_minimal_logs_of_monotone_systems(system: tuple[int, list[frozenset[int]]], parallelism: int) -> None:
    n, causes = system

    def fails(kept: tuple[int, ...]) -> bool:
        return any(cause <= set(kept) for cause in causes)

    result = minimize(n, lambda questions: [fails(question) for question in questions], parallelism=parallelism)
    assert fails(result.kept)
    assert not any(fails(tuple(k for k in result.kept if k != item)) for item in result.kept)


@settings(max_examples=scaled(80), deadline=None)
@given(st.integers(0, 12), st.integers(0, 2**32), st.integers(1, 4))
def test_minimal_logs_of_arbitrary_systems(n: int, salt: int, parallelism: int) -> None:
    def fails(kept: tuple[int, ...]) -> bool:
        return len(kept) == n or hash((salt, kept)) % 3 == 0

    try:
        result = minimize(n, lambda questions: [fails(question) for question in questions], parallelism=parallelism)
    except InconclusiveError:
        return
    assert fails(result.kept)
    if result.kept and not fails(()):
        assert not any(fails(tuple(k for k in result.kept if k != item)) for item in result.kept)


@settings(max_examples=scaled(60), deadline=None)
@given(
    st.lists(st.tuples(st.integers(-3, 3), st.none() | st.integers(-3, 3), st.booleans()), min_size=1, max_size=12),
    st.integers(0, 1000),
    st.integers(1, 4),
)
def test_certificates_differ_in_one_field_and_in_the_outcome(
    spaces: list[tuple[int, int | None, bool]], seed: int, parallelism: int
) -> None:
    fields = [
        FieldSpace(f"f{index}", value, nominal, (-3, -1, 0, 2, 3)) for index, (value, nominal, _) in enumerate(spaces)
    ]
    used = [index for index, (_, _, part) in enumerate(spaces) if part]
    goal = sum(spaces[index][0] for index in used) % 3
    asked: list[Mapping[str, Scalar]] = []

    def fails(question: Mapping[str, Any]) -> bool:
        asked.append(question)
        return sum(question[f"f{index}"] for index in used) % 3 == goal

    result = relevant_fields(fields, lambda qs: [fails(q) for q in qs], seed=seed, parallelism=parallelism)
    for field in result.fields:
        failing, passing = field.certificate.failing, field.certificate.passing
        assert failing in asked
        assert passing in asked
        assert [name for name in failing if not same_scalar(failing[name], passing[name])] == [field.name]
        assert fails(failing)
        assert not fails(passing)
        assert int(field.name[1:]) in used


@st.composite
def rules(draw: st.DrawFn) -> Rule:
    terms = []
    for _ in range(draw(st.integers(0, 3))):
        term = []
        for _ in range(draw(st.integers(0, 3))):
            kind = draw(st.sampled_from(sorted(FEATURE_KINDS)))
            names = tuple(draw(st.sampled_from(["x", "y", "n"])) for _ in range(FEATURE_KINDS[kind][0]))
            if kind in FLAGS:
                term.append(Literal(Feature(kind, names), draw(st.sampled_from(["is", "not"]))))
            else:
                operator = draw(st.sampled_from(["<", "<=", ">", ">=", "==", "!="]))
                term.append(Literal(Feature(kind, names), operator, draw(NUMBERS | st.sampled_from([0, 1.0, -2]))))
        terms.append(tuple(term))
    return Rule(tuple(terms))


@settings(max_examples=scaled(150), deadline=None)
@given(rules(), st.data())
def test_distance_is_negative_exactly_where_the_failure_is_predicted(rule: Rule, data: st.DataObject) -> None:
    rows = data.draw(
        st.lists(
            st.tuples(
                st.floats() | st.sampled_from([0.0, 1.0, -2.0]),
                st.floats(),
                st.integers(-(2**63), 2**63 - 1) | st.sampled_from([0, 1, -2]),
            ),
            min_size=1,
            max_size=8,
        )
    )
    columns = {
        "x": np.array([row[0] for row in rows]),
        "y": np.array([row[1] for row in rows]),
        "n": np.array([row[2] for row in rows], dtype=np.int64),
    }
    scale = {"x": data.draw(st.floats(1e-3, 1e3)), "n": 0.0}
    distance = rule.distance(columns, scale)
    assert np.isfinite(distance).all()
    assert ((distance < 0) == rule.predict(columns)).all()


@settings(max_examples=scaled(150), deadline=None)
@given(rules())
def test_rules_survive_json(rule: Rule) -> None:
    again = Rule.from_json(rule.to_json())
    assert again == rule
    assert again.text() == rule.text()
    compile(again.python(), "rule", "exec")


@settings(max_examples=scaled(300), deadline=None)
@given(NUMBERS, NUMBERS)
def test_the_simplest_number_and_the_middle_lie_between(one: float, other: float) -> None:
    low, high = min(one, other), max(one, other)
    assert low <= simplest(low, high) <= high
    middle = between(low, high)
    if middle is not None:
        assert low < middle < high
    elif isinstance(low, float) and isinstance(high, float):
        assert math.nextafter(low, high) in (low, high) or low == -0.0 == high
