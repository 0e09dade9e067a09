"""Formulas of signal temporal logic, against a plain evaluator of a fragment."""

from __future__ import annotations

import json
import random
import re
import sys
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.monitors.catalogue import build_monitor
from riot_bus.monitors.forging import why_cannot_fire
from riot_bus.monitors.model import TrialView, judge
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError
from riot_bus.vocabulary.message import Message
from riot_bus_forms.temporal import Stl
from riot_bus_testkit.monitors import trial_view
from tests.stl_env import need_rtamt

ANSWERED = "always ((speed > 0.5) implies (eventually[0:2] (ack >= 1)))"
BOUND = {"speed": "cmd:speed", "ack": "status:ok"}

Formula = tuple[Any, ...]


@pytest.fixture(autouse=True, scope="module")
def _rtamt() -> None:
    need_rtamt()


def texts(formula: Formula) -> str:
    match formula:
        case ("atom", name, operator, number):
            return f"({name} {operator} {number})"
        case ("not", one):
            return f"(not {texts(one)})"
        case (("and" | "or" | "implies" | "until") as name, one, two):
            return f"({texts(one)} {name} {texts(two)})"
        case (("always" | "eventually") as name, low, high, one):
            return f"({name}[{low}:{high}] {texts(one)})"
    raise AssertionError(formula)


def ahead(formula: Formula) -> int:
    inner = max((ahead(each) for each in formula if isinstance(each, tuple)), default=0)
    return inner + (formula[2] if formula[0] in ("always", "eventually") else 0)


def robustness(formula: Formula, cell: int, values: dict[str, list[int]]) -> int:
    """Robustness in the second that begins at `cell`; a signal has one value in each second, the last one for ever."""
    match formula:
        case ("atom", name, operator, number):
            value = values[name][min(cell, len(values[name]) - 1)]
            return value - number if operator == ">" else number - value
        case ("not", one):
            return -robustness(one, cell, values)
        case ("and", one, two):
            return min(robustness(one, cell, values), robustness(two, cell, values))
        case ("or", one, two):
            return max(robustness(one, cell, values), robustness(two, cell, values))
        case ("implies", one, two):
            return max(-robustness(one, cell, values), robustness(two, cell, values))
        case ("always", low, high, one):
            return min(robustness(one, each, values) for each in range(cell + low, cell + high + 1))
        case ("eventually", low, high, one):
            return max(robustness(one, each, values) for each in range(cell + low, cell + high + 1))
    raise AssertionError(formula)


def antecedents(formula: Formula) -> list[Formula]:
    match formula:
        case ("implies", one, _):
            return [one]
        case ("and", one, two):
            return antecedents(one) + antecedents(two)
    return []


ATOMS = st.tuples(st.just("atom"), st.sampled_from("xy"), st.sampled_from("<>"), st.integers(0, 4))
BOUNDS = st.tuples(st.integers(0, 2), st.integers(0, 2)).map(sorted)
FORMULAS = st.recursive(
    ATOMS,
    lambda inner: (
        st.tuples(st.just("not"), inner)
        | st.tuples(st.sampled_from(["and", "or", "implies"]), inner, inner)
        | st.builds(lambda name, b, one: (name, *b, one), st.sampled_from(["always", "eventually"]), BOUNDS, inner)
    ),
    max_leaves=5,
)


def seconds(values: dict[str, list[int]], length: int) -> TrialView:
    """A trial in which a message of each signal comes at the beginning of each second."""
    outputs = [
        Message(second * 10**9, name, json.dumps({"v": each[second]}).encode())
        for second in range(length)
        for name, each in values.items()
    ]
    return TrialView([], True, 1.0, TypeRegistry(), outputs, 0, length * 10**9)


@settings(max_examples=150, deadline=None)
@given(FORMULAS, st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=9), st.booleans())
def test_it_says_what_a_plain_evaluator_says(formula: Formula, rows: list[tuple[int, int]], everywhere: bool) -> None:
    values = {"x": [x for x, _ in rows], "y": [y for _, y in rows]}
    text = f"always {texts(formula)}" if everywhere else texts(formula)
    used = {name: f"{name}:v" for name in "xy" if f"({name} " in text}
    monitor, view = Stl(text, used), seconds({name: values[name] for name in used}, len(rows))
    found = judge(view, [monitor])
    assert found.broken == ()
    if len(rows) < ahead(formula):
        assert found.violations == ()
        assert "looks" in found.unseen[0]
        return
    last = len(rows) - ahead(formula) if everywhere else 0  # what begins at the very end is still judged
    all_of = [robustness(formula, cell, values) for cell in range(last + 1)]
    assert bool(found.violations) == (min(all_of) < 0)
    most = [max(robustness(one, cell, values) for cell in range(last + 1)) for one in antecedents(formula)]
    assert bool(found.unseen) == (not found.violations and any(each <= 0 for each in most))
    if found.violations:
        first = next(cell for cell, each in enumerate(all_of) if each < 0)
        assert f"robustness {min(all_of)}, first false {first}.000 s" in found.violations[0].detail


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=9))
def test_unbounded_operators_count_to_the_end(rows: list[tuple[int, int]]) -> None:
    view = seconds({"x": [x for x, _ in rows], "y": [y for _, y in rows]}, len(rows))
    both = {"x": "x:v", "y": "y:v"}
    reached = any(all(x > 1.5 for x, _ in rows[: end + 1]) and y > 2.5 for end, (_, y) in enumerate(rows))
    assert bool(Stl("(x > 1.5) until (y > 2.5)", both).judge(view)) == (not reached)
    assert bool(Stl("eventually (x > 3.5)", {"x": "x:v"}).judge(view)) == (max(x for x, _ in rows) < 3.5)
    before = all(any(x > 1.5 for x, _ in rows[: end + 1]) for end, (_, y) in enumerate(rows) if y > 2.5)
    assert bool(Stl("always ((y > 2.5) implies once (x > 1.5))", both).judge(view)) == (not before)


def test_a_violation_names_fields_robustness_and_the_first_time() -> None:
    view = trial_view([("status", {"ok": True}), *[("status", {"ok": False})] * 40], inputs=[("cmd", {"speed": 0.75})])
    (found,) = Stl(ANSWERED, BOUND).judge(view)
    assert found.component == "cmd:speed, status:ok"
    assert (
        "robustness -0.25, first false 0.100 s after the first input: cmd:speed = 0.75, status:ok = 0" in found.detail
    )


def test_an_input_that_cannot_be_read_changes_nothing() -> None:
    asked = [("cmd", {"speed": 0.75}), ("cmd", b"{"), ("cmd", {}), ("cmd", {"speed": "text"})]
    said = [("status", {"ok": True}), *[("status", {"ok": False})] * 40]
    one, all_of = (trial_view(said, inputs=asked[:count]) for count in (1, 4))
    monitor = Stl(ANSWERED, BOUND)
    assert judge(one, [monitor]) == judge(all_of, [monitor])
    assert judge(one, [monitor]).violations
    assert "not JSON" in judge(trial_view([*said, ("status", b"{")], inputs=asked), [monitor]).broken[0]


def test_an_answer_that_may_still_come_is_not_missed() -> None:
    early = [("status", {"ok": False})] * 25
    view = trial_view([*early, ("status", {"ok": True}), ("status", {"ok": False})], inputs=[("cmd", {"speed": 0.0})])
    assert judge(view, [Stl("always (eventually[0:2.55] (ok >= 1))", {"ok": "status:ok"})]).violations == ()
    assert judge(view, [Stl("always (eventually[0:2.45] (ok >= 1))", {"ok": "status:ok"})]).violations != ()


def test_what_was_not_judged_is_told() -> None:
    monitor = Stl(ANSWERED, BOUND)
    (nothing,) = judge(trial_view([("status", {"ok": True})]), [monitor]).unseen
    assert "no message of 'cmd' came" in nothing
    (short,) = judge(trial_view([("status", {"ok": True}), ("cmd", {"speed": 1})]), [monitor]).unseen
    assert "it looks 2 s ahead" in short
    nan = [("a", {"x": 1.0})] * 3 + [("a", b'{"x": NaN}'), ("a", {"x": 9.0})]
    below = Stl("always (x < 2)", {"x": "a:x"})
    assert "a:x is NaN" in judge(trial_view(nan), [below]).unseen[0]
    assert judge(trial_view([("a", {"x": 3.0}), *nan]), [below]).violations
    infinite = [("a", {"x": 10**400}), ("a", b'{"x": Infinity}'), ("a", b'{"x": -Infinity}')]
    assert "robustness -1.79" in judge(trial_view(infinite), [below]).violations[0].detail
    assert "sqrt" in judge(trial_view([("a", {"x": -1.0})]), [Stl("sqrt(x) < 2", {"x": "a:x"})]).broken[0]
    many = [("a", {"x": number}) for number in range(10_001)]
    assert "at most 10000" in judge(trial_view(many), [below]).broken[0]


@pytest.mark.parametrize(
    ("formula", "told"),
    [
        ("always ((x > 3) implies (y >= 1))", "the robustness of (x)>(3.0) was at most -1, not above 0"),
        ("always ((x >= 2) implies (y >= 1))", "(x)>=(2.0) was at most 0"),
        ("(x > 1) implies (y >= 1)", "(x)>(1.0) was at most 0"),  # it is judged at the beginning
        ("always ((x > 1) implies (y >= 1)) and always ((x > 4) -> (y > 1))", "(x)>(4.0) was at most -2"),
        ("always (((x > 1) implies (y >= 1)) and ((eventually[0:0.1] (x > 4)) -> (y > 1)))", "((x)>(4.0)) was"),
        ("always ((x > 1) implies (y >= 0))", None),
        ("always ((x > 3) or (y >= 0))", None),
    ],
)
def test_an_implication_whose_antecedent_never_holds_has_judged_nothing(formula: str, told: str | None) -> None:
    said = [("s", {"x": 1, "y": 1}), ("s", {"x": 2, "y": 1}), ("s", {"x": 0, "y": 0}), ("s", {"x": 0, "y": 0})]
    found = judge(trial_view(said), [Stl(formula, {"x": "s:x", "y": "s:y"})])
    assert (found.violations, found.broken) == ((), ())
    assert len(found.unseen) == (told is not None)
    assert (told or "") in "".join(found.unseen)
    assert "antecedent never held" in found.unseen[0] if told else True


def test_it_is_shown_to_fire_only_if_its_fields_can_violate_it() -> None:
    both = [("cmd", {"speed": 1}), ("status", {"ok": True, "other": "text"})] * 15
    assert why_cannot_fire(Stl(ANSWERED, BOUND), trial_view(both)) is None
    still = trial_view([("status", {"ok": True})] * 30, inputs=[("cmd", {"speed": 0.0})])
    assert "antecedent never held" in (why_cannot_fire(Stl(ANSWERED, BOUND), still) or "")
    assert Stl(ANSWERED, BOUND).judge(still) == []
    same = Stl("always (x - x <= 0)", {"x": "a:x"})
    assert "no constant values" in (why_cannot_fire(same, trial_view([("a", {"x": 1})])) or "")


@pytest.mark.parametrize(
    ("formula", "signals", "told"),
    [
        ("always (sped > 1)", {"speed": "a:x"}, "'sped'.*did you mean 'speed'"),
        ("speed >", {"speed": "a:x"}, "1:7: Syntax ERROR.*such as"),
        ("speed > 1 speed > 2", {"speed": "a:x"}, "more than one"),
        ("speed > 1", {"speed": "a"}, "does not name a field"),
        ("speed > 1", {"speed": "a:x", "ack": "a:y"}, "'ack' is not in the formula"),
        ("speed > 1", {}, "signals"),
        ("not > 1", {"not": "a:x"}, "cannot name a signal"),
        ("x != 1", {"x": "a:x"}, "never|violated"),
        ("x > 1 " * 200, {"x": "a:x"}, "1000 characters"),
        ("(" * 490 + "x > 1" + ")" * 490, {"x": "a:x"}, "too deeply nested"),
        ("always[2:1] (x > 1)", {"x": "a:x"}, "wrong bounds"),
        ("always[0:1e400] (x > 1)", {"x": "a:x"}, "wrong bounds"),
        ("always[0:500ms] (x > 1)", {"x": "a:x"}, "'ms'|500ms"),
        ("from os import path x > 1", {"x": "a:x"}, "'from'"),
        ("x.real > 1", {"x": "a:x"}, "'real'"),
        ("eventually (always[0:1] (x > 1))", {"x": "a:x"}, "inside an unbounded 'eventually'"),
        ("always (x > 1) and always (eventually[0:1] (x > 1))", {"x": "a:x"}, "two monitors"),
    ],
)
def test_a_wrong_formula_says_where_and_what_to_do(formula: str, signals: dict[str, str], told: str, tmp_path) -> None:
    table = {"kind": "stl", "formula": formula, "signals": signals}
    with pytest.raises(ConfigError, match=f"(?s)here.*({told})"):
        build_monitor(table, where=lambda key: f"here.{key}", root=tmp_path)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32))
def test_any_text_is_a_formula_or_a_config_error(seed: int) -> None:
    parts = [
        "x",
        "(",
        ")",
        ">",
        "<",
        "1",
        "[0:1]",
        "always",
        "until",
        "not",
        "and",
        "-",
        "@",
        "{",
        "import",
        "=",
        "\n",
        ".",
    ]
    chosen = random.Random(seed)
    text = " ".join(chosen.choices(parts, k=chosen.randrange(8)))
    try:
        monitor = Stl(text, {"x": "a:x"})
    except ConfigError:
        return
    judge(trial_view([("a", {"x": 1.0})] * 20), [monitor])


@pytest.mark.parametrize(("version", "told"), [((3, 12), r"'\.\[stl\]'"), ((3, 13), "no release for Python 3.13")])
def test_without_rtamt_it_says_what_to_do(version: tuple[int, int], told: str, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rtamt", None)
    monkeypatch.setattr(sys, "version_info", version)
    with pytest.raises(ConfigError) as raised:
        Stl("x > 1", {"x": "a:x"})
    assert isinstance(raised.value, MissingExtraError) == (version < (3, 13))
    assert re.search(told, str(raised.value))


def test_times_on_a_busy_machine_are_not_judged() -> None:
    view = replace(trial_view([("status", {"ok": False})] * 40, inputs=[("cmd", {"speed": 0.75})]), held_up=1.0)
    assert judge(view, [Stl(ANSWERED, BOUND)]).violations == ()
    (told,) = judge(view, [Stl(ANSWERED, BOUND)]).unseen
    assert told.endswith("it did not hold, but the machine was busy: outputs may be 1.000 s late")
    assert judge(replace(view, held_up=0.1), [Stl(ANSWERED, BOUND)]).violations != ()
    assert judge(view, [Stl("always (ok >= 1)", {"ok": "status:ok"})]).violations != ()
