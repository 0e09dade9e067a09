from __future__ import annotations

from riot_bus.graph.build import build
from riot_bus.graph.model import Graph
from riot_bus.graph.observations import Observations


def test_what_saw_nothing_gives_an_empty_graph() -> None:
    assert build(Observations()) == Graph()
    assert build(Observations(segments=("in", "out"))).components == ()


def test_without_more_knowledge_a_key_is_its_own_name_and_passes_natively() -> None:
    (topic,) = build(Observations(segments=("in",), flows={("a/b", "in"): 3})).topics
    assert (topic.key, topic.name, topic.intercepted) == ("a/b", "a/b", False)


def test_what_was_too_much_to_see_is_told() -> None:
    told = " ".join(each.text for each in build(Observations(segments=("in",), skipped=3, left_out=True)).unknown)
    assert "3 more keys" in told
    assert len(build(Observations(left_out=True)).unknown) == 1
