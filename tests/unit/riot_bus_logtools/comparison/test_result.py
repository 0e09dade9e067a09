from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from riot_bus.vocabulary.errors import DataLossError, InconclusiveError
from tests.unit.riot_bus_logtools.comparison.recordings import said, told

SAME = told(said(b"1", b"2"), said(b"1", b"2"))


def test_the_answer_in_one_line():
    assert SAME.headline() == "a and b are the same: 2 messages of 1 topic"
    assert told(said(b"1"), said(b"2")).headline() == "a and b differ in 1 of 1 topic"
    assert told([], []).headline() == "a and b: nothing could be compared"
    order = replace(SAME, order=replace(SAME.order, moved=1, counts=True))
    assert order.headline() == "a and b differ in the order across topics"


def test_lines():
    found = replace(
        SAME,
        a=replace(SAME.a, missing=("3 damaged chunks",)),
        order=replace(SAME.order, moved=1),
        ignored=("c", "d"),
        notes=("so it is",),
    )
    assert [*found.lines()] == [
        "a and b are the same: 2 messages of 1 topic",
        "= a  2 of 2 equal",
        "timing: a differs most, by 0.000 s (median 0.000 s)",
        "topics not compared: c, d",
        "order across topics: 1 of 2 messages in another one",
        "missing: a: 3 damaged chunks",
        "note: so it is",
    ]


def test_what_is_no_answer():
    with pytest.raises(InconclusiveError, match="nothing could be compared"):
        told(said(b"1"), said(b"1", key="b")).check_compared()
    SAME.check_compared()


def test_the_same_as_far_as_it_can_be_read_is_not_all():
    SAME.check_whole()
    damaged = replace(SAME, b=replace(SAME.b, missing=("3 damaged chunks",)))
    with pytest.raises(DataLossError, match="b: 3 damaged chunks"):
        damaged.check_whole()
    different = told(said(b"1"), said(b"2"))
    replace(different, b=damaged.b).check_whole()


def test_json_holds_what_json_can():
    found = told(said({"x": 1.0, "t": "a"}), said({"x": math.nan, "t": "b"}))
    document = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert (document["version"], document["same"], document["compared"]) == (1, False, 1)
    (topic,) = document["topics"]
    assert (topic["topic"], topic["same"], topic["changed"]) == ("a", False, 1)
    fields = {each["name"]: each for each in topic["fields"]}
    assert (fields["x"]["example"]["after"], fields["x"]["largest"]) == ("nan", "inf")
    bytes_ = told(said(b"\x01"), said(b"\x02")).to_json()["topics"][0]["fields"][0]["example"]
    assert (bytes_["before"], bytes_["after"]) == ("01", "02")
