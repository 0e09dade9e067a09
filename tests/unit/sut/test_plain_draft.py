from __future__ import annotations

import pytest

from riot_bus.graph.model import ConnectedComponent, Edge, Graph
from riot_bus.sut.command_draft import CommandDraft
from riot_bus.sut.plain_draft import PlainFacts, plain_draft
from riot_bus.sut.topic_look import TopicDraft
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
    assert found.system.external == {"pose": "from sim", "stop": "nobody was seen to publish it"}
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
