"""What may be wrong with the form of a message is tried where it can be carried out, and only there."""

from __future__ import annotations

import json

import cbor2
import msgpack
import pytest

from riot_bus.campaign.malformed import malformations
from riot_bus.inject.apply import inject_log
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

WRITERS = {
    "application/json": lambda document: json.dumps(document).encode(),
    "application/msgpack": msgpack.packb,
    "application/cbor": cbor2.dumps,
}
READERS = {"application/json": json.loads, "application/msgpack": msgpack.unpackb, "application/cbor": cbor2.loads}


def log(encoding: str) -> tuple[Message, ...]:
    return tuple(
        Message(
            10**9 + n,
            "a",
            WRITERS[encoding]({"stamp": 5.0 + n, "seq": n, "x": 1.5, "name": "n", "list": [1, 2], "in": {"y": True}}),
            encoding=encoding,
        )
        for n in range(9)
    )


@pytest.mark.parametrize("encoding", WRITERS)
def test_each_is_carried_out(encoding: str) -> None:
    messages, seen = log(encoding), []
    for item in malformations(messages, TypeRegistry()):
        reached: list[list[int]] = []
        delivered, _ = inject_log(messages[:5], item.injections, registry=TypeRegistry(), reached=reached)
        assert all(reached), item
        last = delivered[item.first or 0].payload
        seen.append("cut off" if item.injections[0].fault == "truncate" else READERS[encoding](last))
    nominal = {"stamp": 5.0, "seq": 0, "x": 1.5, "name": "n", "list": [1, 2], "in": {"y": True}}
    for path in ("x", "name"):
        assert {key: value for key, value in nominal.items() if key != path} in seen
        assert nominal | {path: None} in seen
    for path in ("in", "list"):
        assert {key: value for key, value in nominal.items() if key != path} in seen
        assert nominal | {path: None} in seen
        assert nominal | {path: {}} in seen
    assert nominal | {"in": []} in seen
    for change in ({"x": []}, {"x": {}}, {"in": {"y": {}}}, {"list": [[], 2]}):
        assert nominal | change in seen
    for change in ({"x": "1"}, {"name": 1}, {"list": []}, {"list": [None, 2]}):
        assert nominal | change in seen
    assert nominal | {"list": [1, 2, 2]} in seen
    assert nominal | {"stamp": 5.0, "seq": 4} in seen
    assert nominal | {"stamp": 13.0, "seq": 4} in seen
    assert seen.count("cut off") == 2
    assert not any(isinstance(each, dict) and each.get("seq") is None for each in seen)


def test_what_is_left_alone_stays_as_it_is() -> None:
    messages = log("application/json")
    left = malformations(messages, TypeRegistry(), leave=["a:x", "a:list*", "a:stamp"])
    fields = {each.field for item in left for each in item.injections}
    assert fields == {"name", "in", "in.y", None}
    assert malformations(messages, TypeRegistry(), leave=["a:*"]) == []
    assert "seq" in {
        each.field for item in malformations(messages, TypeRegistry(), include=["a:seq"]) for each in item.injections
    }


def test_lists_and_maps_are_left_alone_with_what_is_in_them() -> None:
    document = {"pose": {"at": [{"x": 1, "keep": 2}], "odd key": {"y": 1}}, "header": {"stamp": 5.0}}
    messages = [Message(10**9 + n, "a", json.dumps(document).encode()) for n in range(3)]

    def changed(**options: list[str]) -> set[str]:
        items = malformations(messages, TypeRegistry(), **options)
        faults = [one for item in items for one in item.injections if one.fault == "omit" and not one.options]
        return {str(one.field) for one in faults}

    inner = {"pose.at[0].x", "pose.at[0].keep", 'pose["odd key"].y'}
    assert changed() == inner | {"pose", "pose.at", 'pose["odd key"]'}  # a header is all stamps
    assert changed(leave=["a:pose.at[*].keep"]) == {"pose.at[0].x", 'pose["odd key"]', 'pose["odd key"].y'}
    assert changed(leave=["a:pose"]) == inner | {"pose.at", 'pose["odd key"]'}
    nulled = {one.field for item in malformations(messages, TypeRegistry()) for one in item.injections if one.options}
    assert "pose.at[0]" in nulled


def test_payloads_of_all_topics_are_cut_off_whatever_their_type() -> None:
    payloads = {"raw": b"\x00\x01\x02\x03", "byte": b"\x00", "empty": b""}
    messages = [Message(10**9 + n, key, payload) for n in range(3) for key, payload in payloads.items()]
    kept: dict[str, list[int]] = {}
    for item in malformations(messages, TypeRegistry()):
        (injection,) = item.injections
        assert injection.fault == "truncate"
        delivered, _ = inject_log(messages[:3], item.injections, registry=TypeRegistry())
        kept.setdefault(item.topic, []).extend(len(each.payload) for each in delivered if each.key == item.topic)
    assert kept == {"raw": [2, 0], "byte": [0]}
    assert malformations(messages, TypeRegistry(), leave=["raw:*", "byte:*"]) == []
