from __future__ import annotations

from riot_bus.graph.model import ConnectedComponent, Graph
from riot_bus.sut.command_draft import CommandDraft
from riot_bus.sut.plain_parts import component_names, sessions_by_process


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
