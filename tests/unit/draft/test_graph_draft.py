from __future__ import annotations

import pytest

from riot_bus.draft.graph_draft import (
    Seen,
    component_names,
    graph_draft,
    grouped,
    remark,
    sessions_by_process,
    topic_groups,
    topics_by_name,
    uses_of,
)
from riot_bus.draft.model import CommandDraft, SystemDraft, TopicDraft
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

HOMES = {"sim": "s", "planner": "s", "arm": "s"}
EDGES = [
    ("sim", "publishes", "pose"),
    ("planner", "subscribes", "pose"),
    ("planner", "publishes", "cmd"),
    ("arm", "subscribes", "cmd"),
    ("arm", "subscribes", "stop"),
    ("arm", "serves", "state"),
]


def topic(key: str) -> TopicDraft:
    return TopicDraft(key, key, "json", count=1)


def facts(
    edges: list[tuple[str, str, str]] = EDGES,
    *,
    homes: dict[str, str] | None = None,
    keys: tuple[str, ...] = ("pose", "cmd"),
    mode: str = "client",
) -> Seen:
    homes = HOMES if homes is None else homes
    components = [ConnectedComponent(segment, f"id {name}", mode, command=name) for name, segment in homes.items()]
    found = [Edge(key, role, homes.get(who, "s"), f"id {who}" if who else "") for who, role, key in edges]  # type: ignore[arg-type]
    return Seen(Graph.of(components, (), found, ()), {key: topic(key) for key in keys}, where="tcp/h:1")


def segments(found: SystemDraft) -> dict[str, str]:
    return {part.name: part.segment for part in found.parts}


def command_of(found: SystemDraft, name: str) -> CommandDraft:
    return next(part.command for part in found.parts if part.name == name)


def test_components_topics_and_what_is_external() -> None:
    found = graph_draft(facts())
    uses = {part.name: ([u.topic for u in part.inputs], [u.topic for u in part.outputs]) for part in found.parts}
    assert uses == {"arm": (["cmd", "stop"], []), "planner": (["pose"], ["cmd"]), "sim": ([], ["pose"])}
    assert [part.name for part in found.parts if part.external] == ["sim"]
    assert found.external == {"pose": "from sim", "stop": "no publisher was seen"}
    assert segments(found) == {"arm": "inside", "planner": "inside", "sim": "outside"}
    assert next(part.services for part in found.parts if part.name == "arm") == ("serves state",)
    assert (found.unwritten, found.unread) == ((), ())
    assert not any(part.silent or part.peer for part in found.parts)
    assert not command_of(found, "sim").can_start
    assert "no process of this machine" in command_of(found, "sim").missing[0]


def test_the_segments_of_a_router_stay_if_they_keep_the_outside_apart() -> None:
    homes = {"sim": "world", "planner": "mind", "arm": "body"}
    assert segments(graph_draft(facts(homes=homes))) == homes
    assert set(segments(graph_draft(facts(homes={**homes, "arm": "world"}))).values()) == {"outside", "inside"}


def test_what_is_not_known_is_not_guessed() -> None:
    open_ends = [("", "publishes", "pose"), ("planner", "subscribes", "pose"), ("", "subscribes", "cmd")]
    found = graph_draft(facts(open_ends))
    assert found.unwritten == ("cmd", "pose")
    assert found.unread == ("cmd",)
    assert [part.name for part in found.parts if part.silent] == ["arm", "sim"]
    assert found.external == {}  # pose is published by somebody, who may be one of them


def test_what_users_name() -> None:
    assert graph_draft(facts(), unit="arm").unit == "arm"
    assert graph_draft(facts(), external=["planner"]).external["cmd"] == "from planner"
    with pytest.raises(ConfigError, match="no node 'plannr'"):
        graph_draft(facts(), unit="plannr")
    named = {"id sim": "world", "id planner": "brain", "id arm": "arm"}
    assert [part.name for part in graph_draft(facts(), names=named).parts] == ["arm", "brain", "world"]


def test_commands_and_peers() -> None:
    command = CommandDraft(("p", "{endpoint}"), pid=5)
    seen = facts(mode="peer")
    found = graph_draft(Seen(seen.graph, seen.topics, {"id sim": command}))
    assert command_of(found, "sim") is command
    assert all(part.peer for part in found.parts)


def test_messages_without_components() -> None:
    found = graph_draft(facts([], homes={}))
    assert [part.name for part in found.parts] == ["component"]
    assert found.unwritten == ("cmd", "pose")
    assert "nothing tells what components there are" in command_of(found, "component").missing[0]


def test_nobody_there() -> None:
    with pytest.raises(EnvironmentFaultError, match="neither components nor messages") as caught:
        graph_draft(facts([], homes={}, keys=()))
    assert "tcp/h:1" in str(caught.value)


def component(
    zid: str, command: str = "", pid: int | None = None, segment: str = "s", mode: str = "client"
) -> ConnectedComponent:
    return ConnectedComponent(segment, zid, mode, pid=pid, command=command)


def names(*components: ConnectedComponent, **commands: list[str]) -> dict[str, str]:
    processes = sessions_by_process(Graph.of(components, (), (), ()))
    return component_names(processes, {zid: CommandDraft(tuple(words)) for zid, words in commands.items()})


def test_sessions_of_a_process_belong_together_and_routers_are_none() -> None:
    sessions = [component("a1", pid=7), component("b2", pid=8), component("c3", pid=7, segment="t"), component("d4"),
                component("e5", mode="router")]  # fmt: skip
    found = sessions_by_process(Graph.of(sessions, (), (), ()))
    assert {tuple(each.zid for each in process) for process in found} == {("a1", "c3"), ("b2",), ("d4",)}


def test_components_are_called_as_people_call_them() -> None:
    found = names(component("a1", "planner.py", 1), component("b2", "rover.nav.mapper", 2), component("c3c3c3c3c3", ""),
                  component("d4", "arm-1.2", 4))  # fmt: skip
    assert found == {"a1": "planner", "b2": "mapper", "c3c3c3c3c3": "c3c3c3c3", "d4": "arm-1_2"}


def test_what_is_called_alike_is_told_apart_by_a_word_of_its_own() -> None:
    twins = [component("a1", "node.py", 1), component("b2", "node.py", 2), component("c3", "node.py", 3)]
    found = names(
        *twins, a1=["python", "-v", "--id=7", "sim", "both"], b2=["python", "plan", "both"], c3=["python", "both"]
    )
    assert found == {"a1": "node_sim", "b2": "node_plan", "c3": "node"}
    assert names(*twins) == {"a1": "node", "b2": "node_2", "c3": "node_3"}


NAMES = {"11": "sim", "22": "planner", "33": "planner"}
POSE = TopicDraft(
    "r/1/pose", "r/1/pose", "json", encodings=("application/json",), count=10, rate=5.0, sizes=(3, 9), read=10
)
UUIDS = [f"{number:08x}-0000-4000-8000-000000000000" for number in range(2)]


def edges(*rows: tuple[str, str, str]) -> Graph:
    return Graph.of((), (), [Edge(topic, role, "s", zid) for zid, role, topic in rows], ())  # type: ignore[arg-type]


def test_uses_are_those_of_all_sessions_of_a_component() -> None:
    graph = edges(("11", "publishes", "a"), ("22", "subscribes", "a"), ("33", "subscribes", "b"), ("99", "serves", "c"),
                  ("22", "subscribes", "a/*"), ("22", "subscribes", "x/**"), ("22", "subscribes", "x/1"))  # fmt: skip
    assert uses_of(graph, NAMES) == {
        ("sim", "publishes"): {"a"},
        ("planner", "subscribes"): {"a", "b", "a/*", "x/1"},  # of x/** a key is known
    }


def test_keys_that_are_used_alike_and_have_messages_of_one_kind_are_one_topic() -> None:
    keys = [f"r/{number}/pose" for number in (1, 2, 3)]
    graph = edges(*(("11", "publishes", key) for key in keys))
    topics = {key: TopicDraft(key, key, "json", count=2, rate=1.0, sizes=(n, n), read=2) for n, key in enumerate(keys)}
    uses = uses_of(graph, NAMES)
    groups = topic_groups(graph, uses, topics)
    assert groups == {"r/*/pose": keys}
    (one,) = topics_by_name(groups, topics).values()
    assert (one.count, one.rate, one.sizes, one.read) == (6, 3.0, (0, 2), 6)
    reader = edges(*(("11", "publishes", key) for key in keys), ("22", "subscribes", keys[0]))
    assert topic_groups(reader, uses_of(reader, NAMES), topics).keys() == set(keys)
    unknown = edges(*(("11" if key != keys[2] else "", "publishes", key) for key in keys))
    assert topic_groups(unknown, uses_of(unknown, NAMES), topics).keys() == set(keys)
    assert topic_groups(graph, uses, {**topics, keys[1]: TopicDraft(keys[1], keys[1], "cbor")}).keys() == set(keys)
    assert topics_by_name({"a": ["a"]}, {}) == {}


def test_topics_are_called_as_adapters_do_and_services_are_none() -> None:
    row = Edge("0/odom/T/h", "subscribes", "s", "22"), Edge("q", "serves", "s", "22")
    graph = Graph.of((), [Topic("0/odom/T/h", "/odom")], row, ())
    topics = {"0/odom/T/h": TopicDraft("/odom", "0/odom/T/h", "T")}
    assert topic_groups(graph, uses_of(graph, NAMES), topics) == {"/odom": ["0/odom/T/h"]}


def test_remarks() -> None:
    assert remark(POSE, 3) == "json, application/json, 3 to 9 bytes, 5/s, 3 keys"
    assert remark(TopicDraft("k", "k", count=1, sizes=(4, 4))) == "type unknown, 4 bytes, 1 seen"
    assert remark(None) == "no message was seen"


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (["r/1/p", "r/2/p"], {"r/*/p"}),
        (["r/1/p", "r/20/p", "r/1/q", "r/20/q"], {"r/*/p", "r/*/q"}),
        ([f"r/{each}" for each in UUIDS], {"r/*"}),
        (["r/1/p"], {"r/1/p"}),  # one is no group
        (["r/a/p", "r/b/p"], {"r/a/p", "r/b/p"}),  # names are not numbers
        (["r1/p", "r2/p"], {"r1/p", "r2/p"}),  # a number within a chunk is a name
        (["r/1/2", "r/1/3", "r/2/2"], {"r/1/2", "r/1/3", "r/2/2"}),  # by which of two numbers?
        ([f"r/{a}/{b}" for a in (1, 2) for b in (1, 2, 3)], {"r/1/*", "r/2/*"}),
        (["r/1/p", "r/2/p", "r/x/p"], {"r/1/p", "r/2/p", "r/x/p"}),  # the expression would include another key
    ],
)
def test_keys_that_differ_by_a_number_or_id(keys: list[str], expected: set[str]) -> None:
    found = grouped(dict.fromkeys(keys, "json"))
    assert found.keys() == expected
    assert sorted(key for members in found.values() for key in members) == sorted(keys)


def test_what_is_not_alike_stays_apart() -> None:
    assert grouped({"r/1/p": "json", "r/2/p": "raw"}).keys() == {"r/1/p", "r/2/p"}
    assert grouped({"r/1/p": 0, "r/2/p": 0}, ["r/3/p"]).keys() == {"r/1/p", "r/2/p"}
    assert grouped({}) == {}
