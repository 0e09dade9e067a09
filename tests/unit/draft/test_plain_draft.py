from __future__ import annotations

import pytest

from riot_bus.draft.command_draft import CommandDraft
from riot_bus.draft.plain_draft import PlainFacts, component_names, plain_draft, sessions_by_process
from riot_bus.draft.topic_look import TopicDraft
from riot_bus.graph.model import ConnectedComponent, Edge, Graph
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
) -> PlainFacts:
    homes = HOMES if homes is None else homes
    components = [ConnectedComponent(segment, f"id {name}", mode, command=name) for name, segment in homes.items()]
    found = [Edge(key, role, homes.get(who, "s"), f"id {who}" if who else "") for who, role, key in edges]  # type: ignore[arg-type]
    return PlainFacts(Graph.of(components, (), found, ()), {key: topic(key) for key in keys}, where="tcp/h:1")


def test_components_topics_and_what_is_external() -> None:
    found = plain_draft(facts())
    uses = {part.name: ([u.topic for u in part.inputs], [u.topic for u in part.outputs]) for part in found.system.parts}
    assert uses == {"arm": (["cmd", "stop"], []), "planner": (["pose"], ["cmd"]), "sim": ([], ["pose"])}
    assert [part.name for part in found.system.parts if part.external] == ["sim"]
    assert found.system.external == {"pose": "from sim", "stop": "no publisher was seen"}
    assert found.segments == {"arm": "inside", "planner": "inside", "sim": "outside"}
    assert next(part.services for part in found.system.parts if part.name == "arm") == ("serves state",)
    assert (found.unwritten, found.unread, found.silent, found.peers) == ((), (), (), ())
    assert not found.commands["sim"].can_start
    assert "no process of this machine" in found.commands["sim"].missing[0]


def test_the_segments_of_a_router_stay_if_they_keep_the_outside_apart() -> None:
    homes = {"sim": "world", "planner": "mind", "arm": "body"}
    assert plain_draft(facts(homes=homes)).segments == homes
    assert set(plain_draft(facts(homes={**homes, "arm": "world"})).segments.values()) == {"outside", "inside"}


def test_what_is_not_known_is_not_guessed() -> None:
    open_ends = [("", "publishes", "pose"), ("planner", "subscribes", "pose"), ("", "subscribes", "cmd")]
    found = plain_draft(facts(open_ends))
    assert found.unwritten == ("cmd", "pose")
    assert found.unread == ("cmd",)
    assert found.silent == ("arm", "sim")
    assert found.system.external == {}  # pose is published by somebody, who may be one of them


def test_what_users_name() -> None:
    assert plain_draft(facts(), unit="arm").system.unit == "arm"
    assert plain_draft(facts(), external=["planner"]).system.external["cmd"] == "from planner"
    with pytest.raises(ConfigError, match="no node 'plannr'"):
        plain_draft(facts(), unit="plannr")
    named = {"id sim": "world", "id planner": "brain", "id arm": "arm"}
    assert [part.name for part in plain_draft(facts(), names=named).system.parts] == ["arm", "brain", "world"]


def test_commands_and_peers() -> None:
    command = CommandDraft(("p", "{endpoint}"), pid=5)
    seen = facts(mode="peer")
    found = plain_draft(PlainFacts(seen.graph, seen.topics, {"id sim": command}))
    assert found.commands["sim"] is command
    assert found.peers == ("arm", "planner", "sim")


def test_messages_without_components() -> None:
    found = plain_draft(facts([], homes={}))
    assert [part.name for part in found.system.parts] == ["component"]
    assert found.unwritten == ("cmd", "pose")
    assert "nothing tells what components there are" in found.commands["component"].missing[0]


def test_nobody_there() -> None:
    with pytest.raises(EnvironmentFaultError, match="neither components nor messages") as caught:
        plain_draft(facts([], homes={}, keys=()))
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
