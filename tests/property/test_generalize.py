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


TEXTS = st.text("ab/é\0", max_size=4)
NUMERIC = sorted(kind for kind in FEATURE_KINDS if kind not in FLAGS and kind not in ("len", "bytes"))
OF_TEXTS = sorted({*FLAGS, "len", "bytes"} - {"nan", "nonfinite"})


@st.composite
def features(draw: st.DrawFn, kind: str) -> Feature:
    """A feature of x, y, n, u and m (numbers), s (texts) or b (bytes)."""
    if kind in OF_TEXTS:
        name = draw(st.sampled_from(["s", "b"]))
        letter = draw(st.sampled_from(["a", "/", "é"]))
        constant = None if kind not in ("prefix", "contains") else letter if name == "s" else letter.encode()
        return Feature(kind, (name,), constant)
    arity = FEATURE_KINDS[kind].arity or draw(st.integers(2, 4))
    names = tuple(draw(st.sampled_from(["x", "y", "n", "u", "m"])) for _ in range(arity))
    if kind == "linear":
        weights = (draw(st.sampled_from([1, 400, 0.5])), *(draw(st.sampled_from([1, -2, 0.25])) for _ in names[1:]))
        return Feature(kind, names, weights)
    return Feature(kind, names, draw(st.sampled_from([1, 4, 2**63])) if kind in ("mod", "bits") else None)


@st.composite
def literals(draw: st.DrawFn) -> Literal:
    """A literal of every kind: numbers, flags, sets, booleans, texts and bytes."""
    special = draw(st.integers(0, 9))
    if special == 0:
        return Literal(Feature("raw", ("ok",)), draw(st.sampled_from(["==", "!="])), draw(st.booleans()))
    name = draw(st.sampled_from(["s", "b", "n"]))
    values = {"s": TEXTS, "b": TEXTS.map(str.encode), "n": st.integers(-2, 3)}[name]
    if special == 1:
        members = draw(st.lists(values, min_size=2, max_size=4, unique=True))
        return Literal(Feature("raw", (name,)), draw(st.sampled_from(["in", "not in"])), tuple(members))
    if special == 2:
        return Literal(Feature("raw", (name,)), draw(st.sampled_from(["==", "!="])), draw(values))
    kind = draw(st.sampled_from([*NUMERIC, *OF_TEXTS, "nan", "nonfinite"]))
    feature = draw(features(kind))
    if kind in FLAGS:
        return Literal(feature, draw(st.sampled_from(["is", "not"])))
    operator = draw(st.sampled_from(["<", "<=", ">", ">=", "==", "!="]))
    return Literal(feature, operator, draw(NUMBERS | st.sampled_from([0, 1.0, -2])))


@st.composite
def rules(draw: st.DrawFn) -> Rule:
    return Rule(tuple(tuple(draw(st.lists(literals(), max_size=3))) for _ in range(draw(st.integers(0, 3)))))


ROWS = st.lists(
    st.tuples(
        st.floats() | st.sampled_from([0.0, 1.0, -2.0]),
        st.floats(),
        st.integers(-(2**63), 2**63 - 1) | st.sampled_from([0, 1, -2]),
        TEXTS,
        TEXTS.map(str.encode) | st.just(b"\xff"),
        st.booleans(),
        st.integers(0, 2**64 - 1),
        st.integers(-5, 5) | st.just(math.nan),
    ),
    min_size=1,
    max_size=8,
)


def columns_of_rows(rows: list[tuple[Any, ...]]) -> dict[str, Any]:
    dtypes = {"x": np.float64, "y": np.float64, "n": np.int64, "s": np.object_, "b": np.object_, "ok": np.bool_}
    dtypes |= {"u": np.uint64, "m": np.object_}  # m: the largest element of arrays of integers, NaN where one is empty
    values = zip(*rows, strict=True)
    return {name: np.array(list(some), dtype=dtypes[name]) for name, some in zip(dtypes, values, strict=True)}


@settings(max_examples=scaled(300), deadline=None)
@given(rules(), ROWS, st.floats(1e-3, 1e3))
def test_distance_is_negative_exactly_where_the_failure_is_predicted(
    rule: Rule, rows: list[tuple[Any, ...]], scale: float
) -> None:
    columns = columns_of_rows(rows)
    distance = rule.distance(columns, {"x": scale, "n": 0.0})
    assert np.isfinite(distance).all()
    assert ((distance <= 0) == rule.predict(columns)).all()
    assert (distance != 0).all()


@settings(max_examples=scaled(150), deadline=None)
@given(rules())
def test_rules_survive_json(rule: Rule) -> None:
    again = Rule.from_json(rule.to_json())
    assert again == rule
    assert again.text() == rule.text()


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
