import json
import logging

import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.interceptors.catalogue import build
from riot_bus.interceptors.guard import RuleGuard
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_testkit.interceptors import InterceptorConformance

PRODUCT = Feature("mul", ("a:x", "a:y"))
PAPER = Rule(((Literal(PRODUCT, "<", 0),), (Literal(PRODUCT, ">", 100),)))
OTHER = Rule(((Literal(Feature("sub", ("index:n", "table:size")), ">=", 0),),))
INTEGERS = dict.fromkeys(("a:x", "a:y", "index:n", "table:size"), "int64")


@pytest.fixture
def rule(tmp_path):
    """Write a rule.json as the step does."""

    def write(rule, **more):
        path = tmp_path / "rule.json"
        record = {"rule": rule.to_dict(), "types": INTEGERS, "scale": {}, **more}
        path.write_text(json.dumps(record))
        return path

    return write


class TestGuard(InterceptorConformance):
    @pytest.fixture(autouse=True)
    def _written(self, rule):
        self.path = rule(PAPER)

    def make(self):
        return RuleGuard(self.path, "clamp")


def test_it_stands_in_the_catalogue(rule):
    guard = build("guard", {"rule": str(rule(PAPER)), "action": "hold"})
    assert isinstance(guard, RuleGuard)
    assert guard.topics == ["a"]


@pytest.mark.parametrize("action", ["drop", "clamp", "hold", "report"])
def test_what_does_not_meet_the_rule_passes_as_it_is(rule, bench, action):
    run = bench(RuleGuard(rule(PAPER), action))
    payloads = [b'{"y": 2,  "x": 3, "note": "\\u00e9"}', b'{"x":0,"y":-7}', b'{"x": -10, "y": -10.0}']
    results = [run.feed(0.1 * n, payload) for n, payload in enumerate(payloads)]
    assert run.payloads() == payloads
    assert all(result.emissions[0].message is result.original for result in results)


@pytest.mark.parametrize(
    ("action", "delivered"),
    [
        ("drop", [b'{"x": 5, "y": 6, "n": 1}', b'{"x": 1, "y": 1, "n": 3}']),
        ("clamp", [b'{"x": 5, "y": 6, "n": 1}', b'{"x": 0, "y": 9, "n": 2}', b'{"x": 1, "y": 1, "n": 3}']),
        ("hold", [b'{"x": 5, "y": 6, "n": 1}', b'{"x": 5, "y": 6, "n": 2}', b'{"x": 1, "y": 1, "n": 3}']),
        ("report", [b'{"x": 5, "y": 6, "n": 1}', b'{"x": -4, "y": 9, "n": 2}', b'{"x": 1, "y": 1, "n": 3}']),
    ],
)
def test_what_meets_the_rule(rule, bench, action, delivered, caplog):
    guard = RuleGuard(rule(PAPER), action)
    run = bench(guard)
    for n, (x, y) in enumerate([(5, 6), (-4, 9), (1, 1)]):
        run.feed(0.1 * n, {"x": x, "y": y, "n": n + 1})
    assert run.payloads() == delivered
    assert guard.met == {"a": 1}
    what = {"drop": "dropped", "clamp": "clamped", "hold": "held", "report": "reported"}[action]
    assert guard.done == {what: 1}
    assert f"message 1 of a {what} (a:x = -4, a:y = 9); so far 1" in caplog.text
    run.pipeline.close()
    assert "the rule held for 1 messages: 1 " + what in caplog.text


def test_hold_without_a_good_message_drops(rule, bench):
    guard = RuleGuard(rule(PAPER), "hold")
    run = bench(guard)
    run.feed(0.0, {"x": -4, "y": 9})
    assert run.payloads() == []
    assert guard.done == {"dropped": 1}


def test_a_flood_is_told_ever_more_rarely(rule, bench, caplog):
    run = bench(RuleGuard(rule(PAPER)))
    for n in range(1000):
        run.feed(0.001 * n, {"x": -1, "y": 9})
    assert len(caplog.records) == 10
    assert caplog.records[-1].levelno == logging.WARNING


def test_fields_of_several_topics_are_judged_with_the_latest_delivered_ones(rule, bench):
    run = bench(RuleGuard(rule(OTHER), "drop"))
    steps = [("index", "n", 3), ("table", "size", 4), ("index", "n", 4), ("index", "n", 2), ("table", "size", 2)]
    for n, (key, field, value) in enumerate(steps):
        run.feed(0.1 * n, {field: value}, key=key)
    assert run.payloads() == [b'{"n": 3}', b'{"size": 4}', b'{"n": 2}']


def test_what_was_reported_was_delivered(rule, bench):
    guard = RuleGuard(rule(OTHER), "report")
    run = bench(guard)
    steps = [("table", "size", 4), ("index", "n", 9), ("table", "size", 10), ("table", "size", 5)]
    for n, (key, field, value) in enumerate(steps):
        run.feed(0.1 * n, {field: value}, key=key)
    assert guard.met == {"index": 1, "table": 1}
    assert len(run.payloads()) == 4


def test_clamp_moves_the_field_of_the_message_that_comes(rule, bench):
    run = bench(RuleGuard(rule(OTHER), "clamp"))
    for n, (key, field, value) in enumerate([("table", "size", 4), ("index", "n", 9), ("table", "size", 2)]):
        run.feed(0.1 * n, {field: value}, key=key)
    assert run.payloads() == [b'{"size": 4}', b'{"n": 3}', b'{"size": 4}']


def test_a_message_without_the_fields_passes_and_is_counted(rule):
    pipeline = Pipeline([RuleGuard(rule(PAPER))], registry=TypeRegistry())
    result = pipeline.feed(Message(0, "a", b'{"x": 3}'))
    assert result.emissions[0].message is result.original
    assert pipeline.errors["guard"].count == 1


def test_a_delete_passes(rule, bench):
    run = bench(RuleGuard(rule(PAPER)))
    run.feed(0.0, b"", kind="delete")
    assert [each.message.kind for each in run.delivered] == ["delete"]


def test_other_values_than_numbers_do_not_meet_the_rule(rule, bench):
    run = bench(RuleGuard(rule(PAPER)))
    for value in ("text", True):
        run.feed(0.0, {"x": value, "y": 7})
    assert len(run.payloads()) == 2


def test_a_rule_alone_is_enough_to_drop(tmp_path, bench):
    path = tmp_path / "bare.json"
    path.write_text(PAPER.to_json())
    run = bench(RuleGuard(path))
    run.feed(0.0, {"x": -1, "y": 9})
    assert run.payloads() == []


def several(*names):
    return Rule(((Literal(Feature("mul", names), ">", 3),),))


@pytest.mark.parametrize(
    ("rule_", "action", "message"),
    [
        (several("a[0]:x", "a[999]:x"), "drop", "too long ago|not there"),
        (several("a:x", "b:"), "drop", "not a field of a topic"),
        (several("**:x", "b:y"), "drop", "not a field of a topic"),
        (several("x", "b:y"), "drop", "is not the name of a field"),
        (several("a where b:x", "b:y"), "drop", "not a field of a topic"),
        (Rule(()), "drop", "has no fields"),
        (Rule(((),)), "drop", "has no fields"),
        (several("a:x", "b:y"), "clamp", "know the type of 'b:y'"),
        (
            Rule(((Literal(Feature("nonfinite", ("a:x",)), "is"),),)),
            "clamp",
            "not defined for a: .*no nearest",
        ),
        (several("a:len(x)", "a:len(y)"), "clamp", "know the type of"),
    ],
)
def test_what_it_cannot_carry_out_is_refused_when_it_is_named(rule, rule_, action, message):
    with pytest.raises(ConfigError, match=message) as caught:
        RuleGuard(rule(rule_), action)
    assert "rule.json" in str(caught.value)


JUMP = Rule(((Literal(Feature("sub", ("a[1]:x", "a[0]:x")), ">", 5),),))


@pytest.mark.parametrize(
    ("action", "delivered"),
    [
        ("drop", [0, 4, 9, 7, 12]),
        ("hold", [0, 4, 4, 9, 7, 12]),
        ("clamp", [0, 4, 9, 9, 7, 12]),
        ("report", [0, 4, 10, 9, 7, 12]),
    ],
)
def test_a_jump_is_judged_by_the_message_that_was_delivered_before(rule, bench, action, delivered):
    guard = RuleGuard(rule(JUMP, topics=["a", "a"], types={"a[0]:x": "int64", "a[1]:x": "int64"}), action)
    run = bench(guard)
    for n, x in enumerate([0, 4, 10, 9, 7, 12]):
        run.feed(0.1 * n, {"x": x})
    assert [json.loads(payload)["x"] for payload in run.payloads()] == delivered
    assert guard.met == {"a": 1}


def test_of_a_message_without_the_field_nothing_is_known_afterwards(rule, bench):
    run = bench(RuleGuard(rule(JUMP)))
    for n, payload in enumerate([{"x": 0}, {"y": 1}, {"x": 10}, {"x": 20}]):
        run.feed(0.1 * n, payload)
    assert len(run.payloads()) == 3  # 20 is dropped: it comes after 10
    assert run.pipeline.errors.pop("guard").count == 1


def test_an_order_is_judged_at_the_second_message(rule, bench):
    def delivered(name, *keys):
        terms = Rule(((Literal(Feature("raw", (name,)), "==", True),),))
        run = bench(RuleGuard(rule(terms, types={name: "bool"})))
        for n, key in enumerate(keys):
            run.feed(0.1 * n, {"n": n}, key=key)
        return [each.message.key for each in run.delivered]

    assert delivered("arm before config", "config", "arm", "config", "arm", "config") == ["config", "arm", "arm"]
    assert delivered("arm before the first config", "config", "arm", "config") == ["config", "arm", "config"]
    assert delivered("arm before the first config", "arm", "config", "config") == ["arm"]


def test_elements_of_arrays(rule, bench):
    far = Rule(((Literal(Feature("raw", ("a:max(ranges[*])",)), ">", 100),),))
    run = bench(RuleGuard(rule(far)))
    for n, ranges in enumerate([[1, 2], [1, 200], [], [99.5, 100]]):
        run.feed(0.1 * n, {"ranges": ranges})
    assert [json.loads(payload)["ranges"] for payload in run.payloads()] == [[1, 2], [], [99.5, 100]]


def of_elements(quantity, *literals):
    feature = Feature("raw", (f"a:{quantity}(ranges[*])",))
    return Rule((tuple(Literal(feature, *each) for each in literals),))


def ranges_after(guard, bench, arrays):
    run = bench(guard)
    for n, ranges in enumerate(arrays):
        run.feed(0.1 * n, {"ranges": ranges})
    return [json.loads(payload)["ranges"] for payload in run.payloads()], guard.done


@pytest.mark.parametrize(
    ("quantity", "literal", "bad", "clamped"),
    [
        ("max", (">", 100), [200, 7, 101], [100, 7, 100]),  # any(ranges[*]) > 100
        ("max", ("<=", 3), [1, 3, 2], [1, 4, 2]),  # all(ranges[*]) <= 3
        ("min", ("<", -5), [-9, 7, -6], [-5, 7, -5]),  # any(ranges[*]) < -5
        ("min", (">", 50), [60, 70, 80], [50, 70, 80]),  # all(ranges[*]) > 50
    ],
)
def test_clamp_moves_the_elements_that_are_beyond(rule, bench, quantity, literal, bad, clamped):
    path = rule(of_elements(quantity, literal), types={f"a:{quantity}(ranges[*])": "int64"})
    assert ranges_after(RuleGuard(path, "clamp"), bench, [bad]) == ([clamped], {"clamped": 1})


def test_there_is_no_nearest_number_to_an_element_that_is_none(rule):
    path = rule(of_elements("isnan", ("==", True)), types={"a:isnan(ranges[*])": "bool"})
    with pytest.raises(ConfigError, match="clamp is not defined for a"):
        RuleGuard(path, "clamp")


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("quantity", "literal", "arrays", "delivered", "done"),
    [
        ("isnan", ("==", True), [[1.5, 2.5], [NAN, 3.5]], [[1.5, 2.5], [1.5, 3.5]], {"held": 1}),
        ("nonfinite", ("==", True), [[1.5, 2.5], [4.5, -INF]], [[1.5, 2.5], [4.5, 2.5]], {"held": 1}),
        ("max", (">", 100), [[1, 2], [300, 90]], [[1, 2], [1, 2]], {"held": 1}),  # 90 is beyond the last good 2
        ("isnan", ("==", True), [[1.5, 2.5], [NAN, 3.5, 4.5]], [[1.5, 2.5]], {"dropped": 1}),  # of another length
        ("isnan", ("==", True), [[NAN, 3.5], [1.5, 2.5]], [[1.5, 2.5]], {"dropped": 1}),  # nothing good came before
        ("isnan", ("==", True), [[1.5], [NAN], [2.5], [NAN]], [[1.5], [1.5], [2.5], [2.5]], {"held": 2}),
    ],
)
def test_hold_takes_elements_from_the_last_good_message(rule, bench, quantity, literal, arrays, delivered, done):
    guard = RuleGuard(rule(of_elements(quantity, literal)), "hold")
    assert ranges_after(guard, bench, arrays) == (delivered, done)


def test_lengths_are_not_clamped(rule):
    terms = Rule(((Literal(Feature("raw", ("a:len(x)",)), ">", 3),),))
    with pytest.raises(ConfigError, match="no nearest value"):
        RuleGuard(rule(terms, types={"a:len(x)": "uint16"}), "clamp")


def test_every_topic_of_a_clamp_has_a_field_to_move(rule):
    mode, speed = Feature("raw", ("cmd:mode",)), Feature("raw", ("odom:v",))
    both = Rule(((Literal(mode, "==", "auto"), Literal(speed, ">", 3)),))
    with pytest.raises(ConfigError, match="clamp is not defined for cmd"):
        RuleGuard(rule(both, types={"cmd:mode": "string", "odom:v": "float64"}), "clamp")


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"rule": 5}', '{"rule": {"format": "riot-rule", "version": 9}}', "[" * 100_000, "\xff"]
)
def test_what_is_no_rule(tmp_path, text):
    path = tmp_path / "rule.json"
    path.write_text(text)
    with pytest.raises(ConfigError):
        RuleGuard(path)


def test_a_huge_or_missing_file(tmp_path):
    path = tmp_path / "rule.json"
    with pytest.raises(ConfigError, match="cannot read the rule"):
        RuleGuard(path)
    with path.open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(ConfigError, match="this file has more than"):
        RuleGuard(path)


def test_hostile_additions_do_no_harm(rule, bench):
    path = rule(PAPER, scale={"a:x": -1, "a:y": "9"}, types={**INTEGERS, "a:x": "int64", "z": 7})
    run = bench(RuleGuard(path, "clamp"))
    run.feed(0.0, {"x": -1, "y": 9})
    assert run.payloads() == [b'{"x": 0, "y": 9}']
