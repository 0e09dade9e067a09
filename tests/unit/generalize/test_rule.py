import json
import math
from typing import Any

import numpy as np
import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import FAR, Literal
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import ConfigError

X, Y = "/map_updates:x", "/map_updates:y"
PRODUCT = Feature("mul", (X, Y))
PAPER = Rule(((Literal(PRODUCT, "<", 0),), (Literal(PRODUCT, ">", 4194304),)))
MODE = Rule(((Literal(Feature("raw", ("cmd:mode",)), "==", "auto"), Literal(Feature("raw", ("speed",)), ">", 3.5)),))


def table(x: list[Any], y: list[Any]) -> dict[str, np.ndarray]:
    return {X: np.array(x), Y: np.array(y)}


def test_text() -> None:
    assert PAPER.text() == "/map_updates:x * /map_updates:y < 0 or /map_updates:x * /map_updates:y > 4194304"
    assert MODE.text() == 'cmd:mode == "auto" and speed > 3.5'
    assert Rule(()).text() == "never"
    assert Rule(((),)).text() == "always"
    assert Rule((*MODE.terms, *PAPER.terms[:1])).text().startswith("(cmd:mode")


def test_what_all_terms_need_is_said_once() -> None:
    mode, fast = MODE.terms[0]
    slow, product = Literal(Feature("raw", ("speed",)), "<", 0), PAPER.terms[0][0]
    assert Rule(((mode, fast), (mode, slow))).text() == 'cmd:mode == "auto" and (speed > 3.5 or speed < 0)'
    one_more = Rule(((mode, fast), (mode, slow, product)))
    assert one_more.text().endswith('"auto" and (speed > 3.5 or (speed < 0 and /map_updates:x * /map_updates:y < 0))')
    assert Rule(((mode, fast), (mode,))).text() == 'cmd:mode == "auto"'


def test_predict_is_exact_at_the_threshold() -> None:
    columns = table([2**11, 2**11, -1, 0, 4194305], [2**11, 2**11 + 1, 5, 5, 1])
    assert PAPER.predict(columns).tolist() == [False, True, True, False, True]
    wide = Rule(((Literal(PRODUCT, ">", 2**62),),))
    assert wide.predict(table([2**62, 2**62], [1, 4])).tolist() == [False, True]


def test_known_variables_may_decide() -> None:
    high, low = Literal(Feature("raw", ("speed",)), ">", 3.5), Literal(Feature("raw", ("load",)), "<", 0)
    rule = Rule(((MODE.terms[0][0], high), (low,)))
    columns = {"cmd:mode": np.array(["auto", "off"], dtype=object)}
    sure, possible = rule.judge(columns, 2)
    assert (sure.tolist(), possible.tolist()) == ([False, False], [True, True])
    sure, possible = rule.judge(columns | {"load": np.array([1, 1])}, 2)
    assert (sure.tolist(), possible.tolist()) == ([False, False], [True, False])
    sure, possible = rule.judge({"load": np.array([-1, 1])}, 2)
    assert (sure.tolist(), possible.tolist()) == ([True, False], [True, True])
    whole = columns | {"load": np.array([1, -1]), "speed": np.array([4.0, 0.0])}
    sure, possible = rule.judge(whole, 2)
    assert sure.tolist() == possible.tolist() == rule.predict(whole).tolist() == [True, True]
    assert [each.tolist() for each in rule.judge({}, 1)] == [[False], [True]]


def test_float_thresholds_on_integer_columns() -> None:
    columns = {"n": np.array([3, 4, 2**62])}
    raw = Feature("raw", ("n",))
    for operator, expected in {">": [False, True, True], ">=": [False, True, True], "<": [True, False, False]}.items():
        assert Rule(((Literal(raw, operator, 3.5),),)).predict(columns).tolist() == expected
    assert Rule(((Literal(raw, "<=", 3.5),),)).predict(columns).tolist() == [True, False, False]
    assert Rule(((Literal(raw, "==", 3.5),),)).predict(columns).tolist() == [False] * 3
    assert Rule(((Literal(raw, "<", 2**100),),)).predict(columns).tolist() == [True] * 3


def test_distance_to_the_nearer_axis() -> None:
    scale = {X: 10.0, Y: 100.0}
    rule = Rule(PAPER.terms[:1])
    assert rule.distance(table([5.0, 50.0, -5.0], [300.0, 100.0, 300.0]), scale).tolist() == [0.5, 1.0, -0.5]


def test_distance_falls_towards_the_failure() -> None:
    scale = {X: 10.0, Y: 10.0}
    towards = PAPER.distance(table(list(range(200, -200, -10)), [150] * 40), scale)
    assert (np.diff(towards[:20]) <= 0).all()
    assert (np.diff(towards[6:20]) < 0).all()
    assert ((towards < 0) == PAPER.predict(table(list(range(200, -200, -10)), [150] * 40))).all()
    up = PAPER.distance(table([1000.0, 1500.0, 2000.0, 2040.0], [2048.0] * 4), scale)
    assert (np.diff(up) < 0).all()


def test_distance_is_finite_for_anything() -> None:
    odd = [math.nan, math.inf, -math.inf, 0.0, 1e308]
    columns = table([a for a in odd for _ in odd], [b for _ in odd for b in odd])
    kinds = ["mul", "sub", "add", "div", "hypot", "maxabs", "minabs"]
    for kind in kinds:
        for operator in ("<", ">", "<=", ">=", "==", "!="):
            rule = Rule(((Literal(Feature(kind, (X, Y)), operator, 0.0),), (Literal(Feature("nan", (X,)), "is"),)))
            distance = rule.distance(columns, {X: 0.0, Y: math.nan})
            assert np.isfinite(distance).all()
            assert ((distance < 0) == rule.predict(columns)).all()
            assert (np.abs(distance) <= FAR).all()


def test_categories() -> None:
    columns = {"cmd:mode": np.array(["auto", "auto", "off"], dtype=object), "speed": np.array([9.0, 3.5, 9.0])}
    assert MODE.predict(columns).tolist() == [True, False, False]
    assert (MODE.distance(columns, {}) < 0).tolist() == [True, False, False]
    flag = Rule(((Literal(Feature("raw", ("ok",)), "==", True),),))
    assert flag.predict({"ok": np.array([True, False])}).tolist() == [True, False]
    assert flag.predict({"ok": np.array([1, 0])}).tolist() == [False, False]
    raw = Rule(((Literal(Feature("raw", ("b",)), "!=", b"\0"),),))
    assert raw.predict({"b": np.array([b"\0", b""], dtype=object)}).tolist() == [False, True]


def test_json_round_trip() -> None:
    many = Rule((*PAPER.terms, *MODE.terms, (Literal(Feature("raw", ("b",)), "!=", b"\x00\xff"),), ()))
    assert Rule.from_json(many.to_json()) == many
    assert Rule.from_json(many.to_dict()) == many
    assert PAPER.variables == (X, Y)


def test_whatever_is_written_can_be_read() -> None:
    long = Rule(
        (
            (Literal(Feature("mul3", ("x", "y", "z")), ">", 2**191),),
            (Literal(Feature("linear", ("x", "y"), (2**64 - 1, -(2**64) + 1)), "<=", -(2**129)),),
            (Literal(Feature("raw", ("s",)), "==", "a" * (1 << 20)),),
            (Literal(Feature("raw", ("b",)), "in", (b"\0" * (1 << 20), b"")),),
        )
    )
    assert Rule.from_json(json.dumps(long.to_dict())) == long


def _literal(**changes: Any) -> str:
    item = {"feature": "mul", "args": ["x", "y"], "operator": "<", "value": 0} | changes
    return json.dumps({"format": "riot-rule", "version": 1, "terms": [[item]]})


@pytest.mark.parametrize(
    "source",
    [
        "",
        "[]",
        "{",
        b"\xff\xfe",
        "[" * 100_000,
        '{"format": "riot-rule", "version": 2, "terms": []}',
        '{"format": "riot-rule", "version": true, "terms": []}',
        '{"format": "riot-rule", "version": 1}',
        '{"format": "riot-rule", "version": 1, "terms": [[1]]}',
        '{"format": "riot-rule", "version": 1, "terms": [' + "[]," * 99 + "[]]}",
        _literal(feature="__import__"),
        _literal(feature=["mul"]),
        _literal(args=["x"]),
        _literal(args="xy"),
        _literal(args=["x", "y" * 5000]),
        _literal(operator="is"),
        _literal(operator="; import os"),
        _literal(value="text"),
        _literal(value=None),
        _literal(value=math.nan),
        _literal(value=math.inf),
        _literal(value=2**200),
        _literal(value={"bytes": "zz"}),
        _literal(value={"eval": "1"}),
        _literal(value=[1]),
        _literal(extra=1),
        '{"format": "riot-rule", "version": 1, "terms": [[{"feature": "raw", "args": ["x"], "operator": "<", "value": '
        + "9" * 6000
        + "}]]}",
    ],
)
def test_hostile_json_is_refused(source: str | bytes) -> None:
    with pytest.raises(ConfigError):
        Rule.from_json(source)


def test_missing_columns_are_named() -> None:
    with pytest.raises(ConfigError, match="map_updates:y"):
        PAPER.predict({X: np.array([1])})


def test_a_rule_without_columns_has_no_rows() -> None:
    assert Rule(()).predict({}).shape == (0,)
    assert Rule(((),)).predict({}).shape == (0,)


@pytest.mark.parametrize(("kind", "first"), [("wrap8", 0), ("signed8", -128)])
@pytest.mark.parametrize(("low", "high"), [(60, 61), (0, 30), (0, 255), (200, 255)])
def test_the_way_to_a_range_of_what_wraps_does_not_lead_to_the_jump(kind: str, first: int, low: int, high: int) -> None:
    places, ends = np.arange(first, first + 256), (first + low, first + high)
    total = Feature(kind, ("x", "y"))
    rule = Rule(((Literal(total, ">=", ends[0]), Literal(total, "<=", ends[1])),))
    distance = rule.distance({"x": places - 7, "y": np.full(256, 7)}, {})
    steps = [min(min((place - end) % 256, (end - place) % 256) for end in ends) for place in places.tolist()]
    within = (ends[0] <= places) & (places <= ends[1])
    assert ((distance <= 0) == within).all()
    assert distance[~within].tolist() == [step for step, inside in zip(steps, within, strict=True) if not inside]
