"""What a dictionary applies to in a log, and what of it never can."""

from __future__ import annotations

import json

import pytest

from riot_bus.campaign.bindings import AppliesTo, applied, misfits, naming_nothing
from riot_bus.campaign.targets import targets_of
from riot_bus.inject.dictionary_file import read_file
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from tests.unit.campaign.test_groups import log

DRIVE = {"speed": 1.5, "mode": "auto", "seq": 3, "rows": 2, "cells": [1, 2, 3]}
MESSAGES = [Message(10**9 + n, "drive", json.dumps(DRIVE).encode()) for n in range(9)]
BOUND = '[[field]]\npath = "{}"\nentries = [{{ value = {}, reason = "r" }}]\n'
MUTATED = '[[message]]\ntype = "{}"\nmutations = [{{ set = {{ {} }}, reason = "r" }}]\n'


def wrong(text: str) -> list[str]:
    return [str(each).partition("\n")[0] for each in misfits(text, "own.toml", MESSAGES, TypeRegistry())]


def test_what_applies_is_not_wrong() -> None:
    text = BOUND.format("speed", -9.0) + BOUND.format("drive:seq", 7) + MUTATED.format("json", 'rows = "rows + 1"')
    assert wrong(text) == []


def test_everything_that_never_applies_is_told() -> None:
    text = "".join(
        (
            BOUND.format("sped", 1.0),
            BOUND.format("scan:speed", 1.0),
            BOUND.format("speed", '"fast"'),
            MUTATED.format("jsn", "rows = 1"),
            MUTATED.format("json", "columns = 1"),
        )
    )
    assert wrong(text) == [
        "own.toml: field[0]: no field of the log is called 'sped'",
        "own.toml: field[1]: no field of the log is called 'scan:speed'",
        "own.toml: message[0]: no message of the log is or holds a jsn",
        "own.toml: message[1]: none of its mutations changes a message of the log",
        "own.toml: field[2]: none of the values for 'speed' fits drive:speed, which is a float64",
    ]


def test_a_field_that_its_type_does_not_have_is_told_beside_the_others() -> None:
    messages, registry = log("/odom")
    text = BOUND.format("sped", 1.0) + MUTATED.format("nav_msgs/msg/Odometry", '"twist.twist.linaer.x" = 1.0')
    found = [str(each) for each in misfits(text, "own.toml", messages, registry)]
    assert len(found) == 2
    assert "no field 'twist.twist.linaer.x'" in found[1]


def test_a_file_that_cannot_be_read_is_an_error() -> None:
    with pytest.raises(ConfigError, match=r"entry\[0\].reason"):
        misfits("[[entry]]\nvalue = 1", "own.toml", MESSAGES, TypeRegistry())


def test_what_each_table_applies_to() -> None:
    text = "".join(
        (
            '[[entry]]\ntype = "string"\nvalue = ""\nreason = "r"\n',
            BOUND.format("cells[2]", 9),
            BOUND.format("seq", 9),
            BOUND.format("sped", 9),
            MUTATED.format("json", 'rows = "rows + 1"'),
            MUTATED.format("json", "seq = 1"),
            MUTATED.format("other", "seq = 1"),
        )
    )
    file = read_file(text, where="own.toml")
    found = applied(file, text, MESSAGES, TypeRegistry())
    assert found == {
        "entry[0]": AppliesTo(("drive:mode",), ()),
        "field[0]": AppliesTo(("drive:cells[*]",), ()),
        "field[1]": AppliesTo((), ("drive:seq",)),
        "field[2]": AppliesTo((), ()),
        "message[0]": AppliesTo(("drive",), ()),
        "message[1]": AppliesTo((), ("drive",)),
        "message[2]": AppliesTo((), ()),
    }
    asked = applied(file, text, MESSAGES, TypeRegistry(), leave=["drive:mode"], include=["drive:seq"])
    assert asked["entry[0]"] == AppliesTo((), ("drive:mode",))
    assert asked["field[1]"] == AppliesTo(("drive:seq",), ())
    assert asked["message[1]"].fields == ("drive",)


def test_mutations_apply_wherever_their_type_stands() -> None:
    messages, registry = log("/odom")
    text = MUTATED.format("geometry_msgs/msg/Quaternion", "w = 0.0")
    found = applied(read_file(text, where="own.toml"), text, messages, registry)
    assert found["message[0]"].fields == ("/odom:pose.pose.orientation",)


def test_patterns_that_name_nothing_are_told() -> None:
    document = {"x": 1.5, "ranges": [1.0] * 80, "header": {"seq": 3}, "names": ["a", "b"]}
    log = [Message(0, "scan", json.dumps(document).encode(), encoding="application/json")]
    fields = targets_of(log, TypeRegistry(), include=["*"])
    right = ["scan:x", "scan:*", "*:header.seq", "scan:ranges[3]", "scan:ranges[70]", "scan:len(ranges)", "scan:", "*"]
    wrong = ["scan:y", "cmd:*", "scan:range[3]", "scan", "x"]
    assert naming_nothing([*right, *wrong], fields) == wrong
