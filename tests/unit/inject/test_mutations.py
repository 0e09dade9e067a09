import json

import pytest

from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import Dictionary
from riot_bus.inject.interceptor import Injector
from riot_bus.inject.mutations import mutate
from riot_bus.types.json_type import JsonType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.injection import Formula, Injection
from riot_bus.vocabulary.message import Message
from tests.mutated import breaks

IMAGE = """
[[message]]
type = ["json", "other/msg/Image"]
consistent = "len(data) == w * h"
mutations = [
    { set = { h = "h + 1" }, reason = "a row more" },
    { set = { w = "h", h = "w", "len(data)" = "len(data) - 1" }, reason = "swapped, and one short" },
    { set = { name = "'rgb8'", "data[*]" = 7 }, reason = "literals" },
]
[[message]]
type = "json"
opt_in = true
mutations = [{ set = { w = nan }, reason = "unknown" }]
"""
SOUND = json.dumps({"w": 2, "h": 3, "data": [0, 1, 2, 3, 4, 5], "name": "mono8", "in": {"w": 5}}).encode()


def added(text, **more):
    dictionary = Dictionary()
    dictionary.add(text, where="mine.toml", **more)
    return dictionary


def test_mutations_by_type():
    dictionary = added(IMAGE, own=True)
    rows, swapped, literals, unknown = dictionary.mutations_for("json")
    assert dictionary.mutated_types() == ("json", "other/msg/Image")
    assert len(dictionary.mutations_for("other/msg/Image")) == 3
    assert dictionary.mutations_for("nothing/msg/Known") == ()
    assert rows.changes == (("h", Formula("h + 1")),)
    assert literals.changes == (("name", "rgb8"), ("data[*]", 7))
    assert (rows.own, rows.opt_in, unknown.opt_in, unknown.consistent) == (True, False, True, "")
    assert rows.source == swapped.source == "mine.toml: message[0]"


def test_formulas_read_the_message_as_it_was():
    kind = JsonType()
    rows, swapped, literals, _ = added(IMAGE).mutations_for("json")
    assert not breaks(rows, kind, SOUND)
    assert json.loads(mutate(kind, SOUND, rows.at("")))["h"] == 4
    found = json.loads(mutate(kind, SOUND, swapped.at("")))
    assert (found["w"], found["h"], found["data"]) == (3, 2, [0, 1, 2, 3, 4])
    found = json.loads(mutate(kind, SOUND, literals.at("")))
    assert (found["name"], set(found["data"])) == ("rgb8", {7})
    assert breaks(rows, kind, mutate(kind, SOUND, rows.at("")))


def test_the_injector_makes_the_same_of_them():
    (_, swapped, *_) = added(IMAGE).mutations_for("json")
    plan = [Injection("a", path, value, first=1) for path, value in swapped.at("")]
    out, touched = inject_log([Message(n, "a", SOUND) for n in range(3)], plan, registry=TypeRegistry())
    assert out[0].payload == SOUND
    assert out[1].payload == out[2].payload == mutate(JsonType(), SOUND, swapped.at(""))
    assert [change.field for change in touched[0][2]] == ["w", "h", "len(data)"]
    assert (touched[0][2][2].before, touched[0][2][2].after) == (6, 5)


def test_mutations_of_a_part():
    (rows, *_) = added(IMAGE).mutations_for("json")
    assert rows.at("a[1].b") == (("a[1].b.h", Formula("h + 1", "a[1].b")),)
    kind, payload = JsonType(), json.dumps({"a": [{}, {"b": {"h": 8, "w": 1, "data": [1]}}]}).encode()
    assert json.loads(mutate(kind, payload, rows.at("a[1].b")))["a"][1]["b"]["h"] == 9
    assert breaks(rows, kind, payload, "a[1].b")
    with pytest.raises(PayloadError):
        mutate(kind, payload, rows.at("a[0].b"))


def test_a_formula_without_a_value_leaves_the_message_alone():
    out, touched = inject_log(
        [Message(1, "a", SOUND)], [Injection("a", "w", Formula("h / 0"))], registry=TypeRegistry()
    )
    assert (out[0].payload, touched) == (SOUND, [])
    with pytest.raises(ConfigError, match="formula"):
        Injector([Injection("a", "w", Formula("h +"))])


@pytest.mark.parametrize(
    ("text", "place", "problem"),
    [
        ('type = "a/msg/B"\nmutations = []', "message[0].mutations", "at least 1"),
        ('type = "a/msg/B"', "message[0].mutations", "required"),
        ('type = "a/msg/B"\nmutations = [{ set = {}, reason = "r" }]', "message[0].mutations[0].set", "at least 1"),
        ('type = "a/msg/B"\nmutations = [{ set = { x = 1 } }]', "message[0].mutations[0].reason", "required"),
        (
            'type = "a/msg/B"\nmutations = [{ set = { x = "y +" }, reason = "r" }]',
            "message[0].mutations[0]",
            "cannot read",
        ),
        (
            'type = "a/msg/B"\nmutations = [{ set = { "x y" = 1 }, reason = "r" }]',
            "message[0].mutations[0]",
            "field path",
        ),
        ('type = "a/msg/B"\nmutations = [{ sets = { x = 1 }, reason = "r" }]', "mutations[0].sets", "'set'"),
        ('typ = "a/msg/B"\nmutations = [{ set = { x = 1 }, reason = "r" }]', "message[0].typ", "'type'"),
        (
            'type = "B"\nconsistent = "x ="\nmutations = [{ set = { x = 1 }, reason = "r" }]',
            "consistent",
            "cannot read",
        ),
    ],
)
def test_errors_at_load(text, place, problem):
    with pytest.raises(ConfigError) as caught:
        added(f"[[message]]\n{text}")
    assert "mine.toml" in str(caught.value)
    assert place in str(caught.value)
    assert problem in str(caught.value)
