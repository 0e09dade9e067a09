from __future__ import annotations

import json
from typing import Any

import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule_json import LARGEST_INTEGER, LONGEST_NAME, MOST_TERMS, decode, encode
from riot_bus.vocabulary.errors import ConfigError

ALL_KINDS = (
    (Literal(Feature("raw", ("x",)), ">=", 2.5), Literal(Feature("sub", ("i", "w")), "<", -LARGEST_INTEGER)),
    (Literal(Feature("nan", ("x",)), "is"),),
    (Literal(Feature("raw", ("on",)), "==", True),),
    (Literal(Feature("raw", ("mode",)), "in", (b"\x00\xff", b"b")),),
    (Literal(Feature("raw", ("name",)), "!=", "a\nb"), Literal(Feature("mod", ("n",), 4), "==", 3)),
    (Literal(Feature("contains", ("data",), b"\xf0"), "not"), Literal(Feature("linear", ("a", "b"), (2, -1)), ">", 0)),
    (),
)


def literal(**changes: Any) -> dict[str, Any]:
    return {"feature": "raw", "args": ["x"], "operator": ">", "value": 1} | changes


def rule(*terms: Any, **changes: Any) -> dict[str, Any]:
    return {"format": "riot-rule", "version": 1, "terms": list(terms)} | changes


def test_rules_come_back_through_text() -> None:
    text = json.dumps(encode(ALL_KINDS))
    assert decode(text) == decode(text.encode()) == decode(encode(ALL_KINDS)) == ALL_KINDS
    for before, after in zip(sum(ALL_KINDS, ()), sum(decode(text), ()), strict=True):
        assert type(before.value) is type(after.value)


def test_bytes_are_hexadecimal_and_constants_only_where_there_is_one() -> None:
    (first,), (second,) = encode(((ALL_KINDS[5][0],), (ALL_KINDS[2][0],)))["terms"]
    assert first["constant"] == {"bytes": "f0"}
    assert "constant" not in second


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("{", "not JSON"),
        (b"\xff", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[]", "not a rule"),
        ({"version": 1, "terms": []}, "not a rule"),
        (rule(version=2), "version 2 is not known"),
        (rule(version=True), "version True is not known"),
        (rule(version=1.0), "version 1.0 is not known"),
        (rule(terms={}), "terms of a rule"),
        (rule(*[[]] * (MOST_TERMS + 1)), "at most 64 entries"),
        (rule("x"), "term of a rule"),
        (rule([literal()] * (MOST_TERMS + 1)), "at most 64 entries"),
    ],
)
def test_what_is_not_a_rule_is_refused(source: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        decode(source)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"more": 1}, "no more"),
        ({"feature": ["raw"]}, "are strings"),
        ({"operator": None}, "are strings"),
        ({"args": "x"}, "list of names"),
        ({"args": ["x" * (LONGEST_NAME + 1)]}, "list of names"),
        ({"args": [1]}, "list of names"),
        ({"feature": "eval"}, "unknown feature"),
        ({"value": {"bytes": "0g"}}, "not hexadecimal"),
        ({"value": {"bytes": "00", "more": 1}}, "only be bytes"),
        ({"value": {"bytes": 0}}, "only be bytes"),
        ({"value": LARGEST_INTEGER + 1}, "integer of 194 bits"),
        ({"value": -LARGEST_INTEGER - 1}, "integer of 194 bits"),
        ({"operator": "in", "value": [1, [2]]}, "list is not a single value"),
        ({"operator": "in", "value": list(range(MOST_TERMS + 1))}, "at most 64 entries"),
        ({"value": float("nan")}, "finite"),
    ],
)
def test_a_wrong_literal_is_refused_with_its_place(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        decode(rule([], [literal(), literal(**changes)]))
    assert caught.value.where == "terms[1][1]"


def test_a_literal_that_lacks_something_is_refused() -> None:
    with pytest.raises(ConfigError, match="a literal has"):
        decode(rule([{"feature": "raw", "args": ["x"], "operator": ">"}]))
