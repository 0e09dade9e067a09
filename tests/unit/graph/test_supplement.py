from __future__ import annotations

from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Unknown
from riot_bus.graph.supplement import supplemented, without_listener
from riot_bus.types.capabilities import Announcement

ONE, TWO = ConnectedComponent("a", "11", "client"), ConnectedComponent("b", "22", "client")


def graph(*components: ConnectedComponent, edges: tuple[Edge, ...] = ()) -> Graph:
    return Graph.of(components, (), edges, ())


def writers(found: Graph) -> dict[str, list[str]]:
    edges = [each for each in found.edges if each.role == "publishes"]
    return {topic: [each.zid for each in edges if each.topic == topic] for topic in {each.topic for each in edges}}


def test_a_segment_that_a_message_names_has_its_publisher() -> None:
    found = supplemented(graph(ONE, TWO), {("x", "a"): 5, ("y", "b"): 1, ("z", ""): 2})
    assert writers(found) == {"x": ["11"], "y": ["22"]}
    assert [topic.key for topic in found.topics] == ["x", "y", "z"]
    assert found.components == graph(ONE, TWO).components


def test_the_only_segment_is_that_of_all_messages_and_its_only_component_the_publisher() -> None:
    counts = {("x", ""): 5}
    assert writers(supplemented(graph(ONE), counts)) == {"x": ["11"]}
    assert writers(supplemented(graph(ONE), counts, complete=False)) == {}
    other = ConnectedComponent("a", "33", "client")
    assert writers(supplemented(graph(ONE, other), counts)) == {"x": [""]}  # one of them


def test_stamps_tell_the_publisher_wherever_it_is() -> None:
    everybody = graph(ONE, ConnectedComponent("a", "33", "client"), TWO)
    senders = {"x": {"33", "ffff"}, "y": {"ffff"}, "z": {"11", "22"}}
    found = supplemented(everybody, {(key, ""): 3 for key in senders}, senders=senders)
    assert writers(found) == {"x": ["33"], "z": ["11", "22"]}
    assert all("timestamp" in each.evidence for each in found.edges)


def test_what_was_known_stays_and_evidence_adds_up() -> None:
    known = Edge("x", "publishes", "a", "11", evidence=("traffic",), messages=7)
    somebody = Edge("x", "subscribes", "b", evidence=("matching",))
    before = Graph.of([ONE], (), [known, somebody], [Unknown("11", "a", "announces nothing")])
    token = Announcement("11", "publishes", "x", "", "", "", "advanced token")
    found = supplemented(before, {("x", "a"): 9}, tokens=[token])
    assert [(each.role, each.zid, each.evidence) for each in found.edges] == [
        ("publishes", "11", ("advanced token", "traffic")),
        ("subscribes", "", ("matching",)),
    ]
    assert found.unknown == before.unknown


def test_who_reads_everything_tells_nothing_of_others() -> None:
    def reads(topic: str, where: ConnectedComponent) -> Edge:
        return Edge(topic, "subscribes", where.segment, where.zid, evidence=("matching", "only component"))

    writes = Edge("x", "publishes", "a", "11", evidence=("traffic",)), Edge("y", "publishes", "b", "22")
    plain = graph(ONE, TWO, edges=(*writes, reads("x", TWO), reads("y", ONE)))
    assert without_listener(plain) == (plain, False)
    heard = graph(ONE, TWO, edges=(*plain.edges, reads("x", ONE)))
    found, listener = without_listener(heard)
    assert listener
    assert [(each.topic, each.role, each.zid) for each in found.edges] == [
        ("x", "publishes", "11"), ("x", "subscribes", "22"), ("y", "publishes", "22"),
    ]  # fmt: skip
    somebody = (
        Edge("x", "subscribes", "a", evidence=("matching",)),
        Edge("y", "subscribes", "a", evidence=("matching",)),
    )
    crowd = graph(ONE, ConnectedComponent("a", "33"), edges=(*writes, *somebody))
    assert without_listener(crowd) == (crowd, False)
