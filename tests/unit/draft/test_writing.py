from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

from riot_bus.draft.graph_draft import Seen, SystemDraft, graph_draft
from riot_bus.draft.model import CommandDraft, TopicDraft
from riot_bus.draft.writing import draft_json, draft_lines, draft_toml, left_to_fill_in
from riot_bus.graph.model import ConnectedComponent, Edge, Graph
from riot_bus.system.system_file import SystemFile

SIM = CommandDraft(("{python}", "sim.py", "-e", "{endpoint}"), "w", {"A": "1", "odd name": 'x"\n'}, pid=7)
ARM = CommandDraft(("FILL_IN", "arm"), missing=("{endpoint} where it is told to connect",))
TOPICS = {
    "pose/1": TopicDraft(
        "pose/1", "pose/1", "json", encodings=("application/json",), count=9, rate=3.0, sizes=(5, 5), read=9
    ),
    "pose/2": TopicDraft(
        "pose/2", "pose/2", "json", encodings=("application/json",), count=9, rate=3.0, sizes=(5, 6), read=9
    ),
    "cmd": TopicDraft("cmd", "cmd", "cbor", declare=True, encodings=("zenoh/bytes",), count=4, sizes=(2, 2), read=4),
    "mode": TopicDraft("mode", "mode", fits=("cbor", "json"), count=4, sizes=(1, 1), read=4),
    "raw": TopicDraft("raw", "raw", encodings=("application/protobuf;a.B",), count=4, sizes=(12, 20), read=4),
    "tick": TopicDraft("tick", "tick", count=4),
}


def draft(*edges: tuple[str, str, str], unit: str | None = None) -> SystemDraft:
    components = [ConnectedComponent("s", zid, "client", command=name) for zid, name in (("1", "sim.py"), ("2", "arm"))]
    rows = [Edge(key, role, "s", zid) for zid, role, key in edges]  # type: ignore[arg-type]
    return graph_draft(Seen(Graph.of(components, (), rows, ()), TOPICS, {"1": SIM, "2": ARM}), unit=unit)


WRITTEN = {"file": "riot.toml"}
ALL = [
    *(("1", "publishes", key) for key in TOPICS if key != "cmd"),
    *(("2", "subscribes", f"pose/{n}") for n in (1, 2)),
]


def text_of(found: SystemDraft) -> str:
    return draft_toml(found, origin="a test\nwith = 'two lines'", name="na\nme", nominal="n.mcap")


def parsed(found: SystemDraft) -> SystemFile:
    return SystemFile.model_validate({**tomllib.loads(text_of(found)), "path": Path("riot.toml").resolve()})


def test_the_file_has_what_is_known() -> None:
    found = draft(*ALL)
    file = parsed(found)
    assert (file.system.name, file.system.nominal, file.system.segments) == ("na\nme", "n.mcap", ("outside", "inside"))
    sim, arm = file.components["sim"], file.components["arm"]
    assert (sim.command, sim.cwd, sim.env) == (SIM.command, "w", {"A": "1", "odd name": 'x"\n'})
    assert (sim.external, sim.segment, arm.segment) == (True, "outside", "inside")
    assert sim.outputs == ("mode", "pose/*", "raw", "tick")
    assert arm.inputs == ("pose/*",)
    assert file.external.topics == ("pose/1", "pose/2")  # by key: runs of the whole system change these
    assert file.system.types == {"cmd": "cbor"}
    assert set(file.unit) == {"arm"}
    text = text_of(found)
    assert '"cmd" = "cbor"   # all 4 payloads read so, but their encoding is zenoh/bytes' in text
    assert '# "mode" = "cbor"   # FILL IN: cbor or json? all 4 payloads, of 1 byte, can be read so' in text
    assert '# "raw" = "raw"   # FILL IN: application/protobuf;a.B, 12 to 20 bytes: no codec reads them' in text
    assert '# messages = ["NAME.desc"]' in text
    assert "# as process 7 was started" in text
    assert '"pose/*",   # json, application/json, 5 to 6 bytes, 6/s, 2 keys' in text


def test_what_is_left_to_fill_in_is_what_the_file_marks() -> None:
    found = draft(*ALL)
    assert left_to_fill_in(found) == [
        "types: mode: cbor or json? all 4 payloads, of 1 byte, can be read so",
        "types: raw: application/protobuf;a.B, 12 to 20 bytes: no codec reads them; a packed structure is "
        "raw(float32 x, uint8 mode)",
        "components.arm: {endpoint} where it is told to connect",
        "external: who publishes cmd",
    ]
    for line in text_of(found).splitlines():
        if "FILL IN" in line:
            assert line.startswith("#")
    silent = draft()
    assert "components.sim: what it reads and writes" in left_to_fill_in(silent)
    assert left_to_fill_in(silent)[-1] == "unit: the component that is to be tested"
    assert "# [unit.NAME]   # FILL IN" in text_of(silent)
    assert "The components of these topics are unknown: cmd, mode, pose/*, raw, tick" in text_of(silent)
    assert set(parsed(draft(unit="arm")).unit) == {"arm"}


def test_nothing_left() -> None:
    found = draft(("1", "publishes", "pose/1"), ("2", "subscribes", "pose/1"))
    parts = tuple(replace(part, command=SIM) for part in found.parts)
    found = replace(found, parts=parts, topics={}, unwritten=())
    assert left_to_fill_in(found) == []
    assert "FILL IN" not in text_of(found)
    lines = draft_lines({**WRITTEN, **draft_json(found), "started": True})
    assert lines[-2] == "nothing is left to fill in; next: riot test"
    assert "types" not in tomllib.loads(text_of(found))["system"]


def test_what_people_are_told() -> None:
    lines = draft_lines({**WRITTEN, **draft_json(draft(*ALL)), "started": False})
    assert lines[0] == "arm  inside   1 in, 0 out  FILL_IN arm"
    assert lines[1] == "sim  outside  0 in, 4 out  '{python}' sim.py -e '{endpoint}'"
    assert lines[2] == "external topics: pose/*"
    assert "published by an unknown component: cmd" in lines
    assert any(line.startswith("FILL IN components.arm") for line in lines)
    silent = {**WRITTEN, **draft_json(draft()), "started": False}
    assert draft_lines(silent)[-2].startswith("--start starts each component once")
    assert not draft_lines({**silent, "started": True})[-2].startswith("--start")
    heard = draft_lines({**silent, "listener": True, "skipped": 3, "unknown_receiver": ["a\x1b[31m"]})
    assert "a component reads everything, such as a recorder, which hides what the others read" in heard
    assert "3 more keys were too many to look at" in heard
    assert "read by an unknown component: a\\x1b[31m" in heard


def test_texts_from_the_network_stay_texts() -> None:
    evil = 'x"]\n[components.evil]\ncommand = ["rm"]'
    component = ConnectedComponent("s", "1", "client", name=evil)
    topic = TopicDraft(evil, evil, evil, declare=True, encodings=(evil,), count=1, sizes=(1, 1), read=1)
    seen = Seen(Graph.of([component], (), [Edge(evil, "subscribes", "s", "1")], ()), {evil: topic})
    found = graph_draft(seen)
    file = parsed(replace(found, parts=(replace(found.parts[0], peer=True),)))
    (only,) = file.components.values()
    assert only.inputs == (evil,)
    assert file.system.types == {evil: evil}
