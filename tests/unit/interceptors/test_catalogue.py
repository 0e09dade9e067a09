import pytest

from riot_bus.interceptors.catalogue import build, interceptor_list
from riot_bus.interceptors.losses import Drop
from riot_bus.interceptors.timing import Delay
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.vocabulary.errors import ConfigError

MINE = """
from __future__ import annotations
from dataclasses import dataclass

@dataclass
class Mine:
    '''Do something.

    Args:
        every: How often,
            in messages.
    '''
    every: int = 5
    factor: float | None = None
    def message(self, event): ...

class Plain:
    def __init__(self, size: int, label="x"):
        self.size, self.label = size, label
        if size < 0:
            raise ValueError("too small")
    def message(self, event): ...

class Bare:
    def message(self, event): ...

class Own:
    def __init__(self, start: str = ""):
        self.start_text = start
    def message(self, event): ...
"""


@pytest.fixture
def mine(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(MINE)
    return str(file)


def test_without_conditions_it_is_the_bare_interceptor():
    assert build("delay", {"seconds": 0.5}) == Delay(0.5)


def test_conditions_and_options_are_told_apart():
    built = build(
        "drop",
        {
            "select": ["/odom", "/scan where x > 1"],
            "from": "system",
            "to": "unit",
            "start": 1,
            "end": 2.5,
            "first": 3,
            "last": 9,
            "where": "x > 3",
            "probability": 0.5,
            "seed": 7,
            "name": "loss",
            "every": 2,
        },
    )
    when = When(("/odom", "/scan where x > 1"), "system", "unit", 1, 2.5, 3, 9, "x > 3", 0.5, 7)
    assert built == Selective(Drop(every=2), when, "loss")


def test_one_selector_needs_no_list():
    assert build("drop", {"select": "/odom"}).when.select == "/odom"


def test_values_are_converted(mine):
    built = build(f"{mine}:Mine", {"every": "7", "factor": 2})
    assert (built.every, built.factor) == (7, 2.0)


def test_plain_classes_take_the_arguments_of_init(mine):
    built = build(f"{mine}:Plain", {"size": 3, "first": 2})
    assert (built.interceptor.size, built.interceptor.label, built.when.first) == (3, "x", 2)
    assert type(build(f"{mine}:Bare", {})).__name__ == "Bare"


def test_an_own_option_wins_over_a_condition_of_its_name(mine):
    assert build(f"{mine}:Own", {"start": "noon"}).start_text == "noon"


@pytest.mark.parametrize(
    ("use", "options", "parts"),
    [
        ("dorp", {}, ["unknown interceptor 'dorp'", "did you mean 'drop'"]),
        ("drop", {"evry": 2}, ["place: drop", "unknown option 'evry'", "'every'"]),
        ("drop", {"probabilty": 2}, ["unknown option 'probabilty'", "'probability'"]),
        ("drop", {"every": "often"}, ["place: drop", "every: ", "valid integer", "'often'"]),
        ("drop", {"every": 0}, ["place: drop", "must be 1 or more"]),
        ("drop", {"probability": 2}, ["place: drop", "not between 0 and 1"]),
        ("drop", {"where": "x >"}, ["place: drop", "expected a number"]),
        ("drop", {"select": "/odom:x"}, ["chooses a field"]),
        ("drop", {"first": "x"}, ["first: ", "valid integer"]),
        ("delay", {}, ["place: delay", "'seconds'"]),
        ("clock_offset", {"seconds": 1, "unit": "h"}, ["unit: ", "'h'"]),
        ("record", {"path": "x", "compression": "zip"}, ["compression: ", "'zip'"]),
        ("none.py", {}, ["no such file"]),
        ("MINE:Mien", {}, ["no class 'Mien' with a method message()", "'Mine'"]),
        ("MINE:Bare", {"x": 1}, ["unknown option 'x'"]),
        ("MINE:Plain", {}, ["'size'"]),
        ("MINE:Plain", {"size": -1}, ["too small"]),
        ("MINE:Plain", {"size": "big"}, ["size: ", "'big'"]),
    ],
)
def test_errors(mine, use, options, parts):
    with pytest.raises(ConfigError) as caught:
        build(use.replace("MINE", mine), options, where="place")
    for part in parts:
        assert part in str(caught.value)


def test_every_shipped_one_and_all_its_options_are_described():
    found = {each["name"]: each for each in interceptor_list()}
    for name, each in found.items():
        assert each["summary"].endswith((".", ":")), name
        assert all(option["doc"] and option["type"] for option in each["options"]), name
    options = {option["name"]: option for option in found["jitter"]["options"]}
    assert list(options) == ["seconds", "spread"]
    assert options["spread"]["required"]
    assert options["spread"]["type"] == "float"
    (hold,) = found["freeze"]["options"]
    assert (hold["default"], hold["required"]) == ("0", False)


def test_those_of_others_are_found(installed):
    installed("riot_bus.interceptors", slow="riot_bus.interceptors.timing:Delay")
    assert build("slow", {"seconds": 1}) == Delay(1)
    assert "slow" in {each["name"] for each in interceptor_list()}


def test_a_broken_one_does_not_hide_the_others(installed):
    installed("riot_bus.interceptors", broken="no_such_module:X", function="json:dumps")
    with pytest.raises(ConfigError, match="cannot be loaded"):
        build("broken", {})
    with pytest.raises(ConfigError, match="is not a class"):
        build("function", {})
    found = {each["name"]: each for each in interceptor_list()}
    assert "cannot be loaded" in found["broken"]["summary"]
    assert found["drop"]["options"]


def test_every_shipped_interceptor_is_listed_with_its_options() -> None:
    found = {each["name"]: each for each in interceptor_list()}
    assert {"drop", "delay"} <= found.keys()
    assert all(each["summary"] for each in found.values())
