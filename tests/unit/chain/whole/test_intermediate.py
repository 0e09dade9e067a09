"""What is looked at between the outside and the inside, and which path is the most permeable one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus.chain.steps.permeability import permeability
from riot_bus.chain.whole.intermediate import intermediate_fields, most_permeable_paths, with_strengths
from riot_bus.findings.permeability import EdgeRecord
from riot_bus.log.reader import read_log
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import LOGGED, SPEED, bench, commands, panel, said, write_fields, write_minimal


def graph(**components: tuple[str, str]) -> TopicGraph:
    """Return a graph of components by what they read and write, names parted by spaces."""
    return TopicGraph(
        {
            name: ComponentTopics(frozenset(reads.split()), frozenset(writes.split()))
            for name, (reads, writes) in components.items()
        }
    )


def edge(external: str, internal: str, strength: float, *, permeable: bool = True) -> EdgeRecord:
    return EdgeRecord(
        external=external, internal=internal, permeable=permeable, strength=strength, low=0.1, high=1, lag_s=0,
        p_value=0,
    )  # fmt: skip


TWO_WAYS = graph(scan=("lidar", "map"), fuse=("map gps", "pose"), guide=("pose", "command"), short=("gps", "command"))
EDGES = [
    edge("gps:lat", "command:speed", 0.6),
    edge("gps:lat", "pose:x", 0.3),
    edge("gps:lat", "pose:y", 0.9, permeable=False),
    edge("lidar:range", "command:speed", 0.5),
    edge("lidar:range", "map:free", 0.9),
    edge("lidar:range", "pose:x", 0.8),
]


def tree_of(graph: TopicGraph) -> dict[str, Any]:
    return graph.backtrack_tree("command", ["gps", "lidar"]).as_json()


def test_the_path_is_named_on_which_most_gets_through_where_it_is_weakest() -> None:
    (path,) = most_permeable_paths([tree_of(TWO_WAYS)], EDGES)
    assert str(path) == "gps:lat -> command:speed (0.6)", "the short way, not that over the pose"
    longer = graph(scan=("lidar", "map"), fuse=("map gps", "pose"), guide=("pose", "command"))
    (path,) = most_permeable_paths([tree_of(longer)], EDGES)
    assert str(path) == "lidar:range -> map:free (0.9) -> pose:x (0.8) -> command:speed (0.5)"


def test_a_path_of_which_not_all_is_known_is_not_named_but_counted() -> None:
    two = graph(left=("gps", "blocked"), right=("gps", "open"), both=("blocked open", "command"))
    edges = [edge("gps:lat", "command:speed", 0.6), edge("gps:lat", "blocked:x", 0.01, permeable=False)]
    assert most_permeable_paths([tree_of(two)], edges) == (), "nothing is known of one, and nothing passes the other"
    (path,) = most_permeable_paths([tree_of(two)], [*edges, edge("gps:lat", "open:x", 0.9)])
    assert (str(path), path.unknown) == ("gps:lat -> open:x (0.9) -> command:speed (0.6)", 0)
    (path,) = most_permeable_paths([tree_of(TWO_WAYS)], [one for one in EDGES if one.internal != "map:free"])
    assert path.unknown == 1
    assert str(path) == "gps:lat -> command:speed (0.6), as far as is known (1 path not looked at whole)"


def test_what_comes_back_from_the_inside_is_no_path_from_outside() -> None:
    loop = graph(drive=("odom", "wheels"), sim=("wheels goal", "odom"))
    tree = loop.backtrack_tree("odom", ["odom", "goal"]).as_json()
    edges = [edge("odom:x", "odom:x", 0.9), edge("odom:x", "wheels:speed", 0.9), edge("goal:x", "odom:x", 0.5)]
    (path,) = most_permeable_paths([tree], edges)
    assert str(path) == "goal:x -> odom:x (0.5)"


def test_there_is_no_path_to_what_nothing_reaches() -> None:
    assert most_permeable_paths([tree_of(TWO_WAYS)], []) == ()
    assert most_permeable_paths([tree_of(TWO_WAYS)], [edge("gps:lat", "command:speed", 0.1, permeable=False)]) == ()
    assert most_permeable_paths([tree_of(TWO_WAYS)], [edge("gps:lat", "pose:x", 0.9)]) == ()


def test_each_topic_of_the_tree_says_what_of_it_follows_the_outside_most() -> None:
    tree = with_strengths(tree_of(TWO_WAYS), EDGES)
    assert (tree["follows"]["external"], tree["follows"]["strength"]) == ("gps:lat", 0.6)
    by_topic = {hop["topic"]: hop for hop in tree["hops"]}
    assert by_topic["gps"]["follows"] is None
    assert by_topic["pose"]["follows"]["external"] == "lidar:range"
    assert {hop["topic"]: hop["follows"] for hop in by_topic["pose"]["hops"]}["map"]["strength"] == 0.9


MIXED = LOGGED.replace('inputs = ["panel"]', 'inputs = ["mixed"]').replace(
    "[components.drive]",
    '[components.mixer]\ncommand = ["mixer"]\nsegment = "inside"\ninputs = ["panel"]\noutputs = ["mixed"]\n\n'
    "[components.drive]",
)
"""The same machine with a mixer before the governor."""


def mix(readings: Sequence[Message], **more: object) -> list[Message]:
    """What the mixer says: a number that follows the knob, one that follows nothing, and others that tell nothing."""
    return [
        reading.with_(
            key="mixed",
            time=reading.time + 500,
            payload=json.dumps(
                {"half": said(reading)["knob"] / 2, "count": place % 7, "always": 1.0, "name": "mixer", **more}
            ).encode(),
        )
        for place, reading in enumerate(readings)
    ]


def mixed(readings: Sequence[Message]) -> list[Message]:
    return [*mix(readings), *commands(readings)]


def test_fields_on_the_way_are_those_that_vary(tmp_path: Path) -> None:
    write_mixed(tmp_path)
    workspace = bench(tmp_path, MIXED).workspace
    way = graph(mixer=("panel", "mixed"), governor=("mixed", "command"), drive=("command", ""))
    assert intermediate_fields(workspace, way, ["command"], ["panel"]) == ("mixed:half", "mixed:count")
    assert intermediate_fields(workspace, way, ["mixed"], ["panel"]) == ()


def test_fields_whose_names_no_run_can_be_asked_for_are_not_looked_at(tmp_path: Path) -> None:
    write_mixed(tmp_path)
    messages = read_log(tmp_path / "nominal.mcap")
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for place, message in enumerate(messages):
            fields = {"front-left": place} if message.key == "mixed" else {}
            writer.write(message.with_(payload=json.dumps(said(message) | fields).encode()))
    workspace = bench(tmp_path, MIXED).workspace
    way = graph(mixer=("panel", "mixed"), governor=("mixed", "command"), drive=("command", ""))
    assert intermediate_fields(workspace, way, ["command"], ["panel"]) == ("mixed:half", "mixed:count")


def test_topics_with_large_messages_are_not_looked_at(tmp_path: Path) -> None:
    write_mixed(tmp_path, mass="." * 20_000)
    workspace = bench(tmp_path, MIXED).workspace
    way = graph(mixer=("panel", "mixed"), governor=("mixed", "command"), drive=("command", ""))
    assert intermediate_fields(workspace, way, ["command"], ["panel"]) == ()


def test_permeability_tells_what_gets_through_on_the_way(tmp_path: Path) -> None:
    write_mixed(tmp_path)
    one = bench(tmp_path, MIXED, governor=mixed)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert record.permeable == ("panel:knob",)
    shares = {(each.external, each.internal): each.strength * each.permeable for each in record.intermediate}
    assert shares["panel:knob", "mixed:half"] > 0.9
    assert all(share < 0.1 for pair, share in shares.items() if pair != ("panel:knob", "mixed:half"))
    assert {each.internal for each in record.edges} == {SPEED}
    (path,) = record.paths
    assert [stage.field for stage in path.stages] == ["mixed:half", SPEED]
    assert "; most permeable path: panel:knob -> mixed:half (" in record.summary
    assert record.tree[0]["hops"][0]["follows"]["internal"] == "mixed:half"


def write_mixed(folder: Path, **more: object) -> None:
    readings = panel(0)
    made = [*mix(readings, **more), *commands(readings)]
    with LogWriter(folder / "nominal.mcap") as writer:
        for message in sorted([*readings, *made], key=lambda each: each.time):
            writer.write(message)
