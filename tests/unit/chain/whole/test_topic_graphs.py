from __future__ import annotations

from riot_bus.chain.whole.topic_graphs import declared_graph, topics_named
from riot_bus.system.system_file import load_system
from riot_bus.types.registry import TypeRegistry
from tests.unit.chain.offline import SYSTEM

KEYS = {"goal": "goal", "map": "map", "odom": "odom", "unit": "unit", "arm/left": "arm/left", "arm/right": "arm/right"}


def test_what_riot_toml_declares_has_external_components_and_the_names_of_logs(tmp_path):
    (tmp_path / "riot.toml").write_text(SYSTEM.replace('"lost"', '"arm/*"'))
    graph = declared_graph(load_system(tmp_path / "riot.toml"), KEYS, TypeRegistry([]))
    assert graph.components["planner"].inputs == {"map", "odom", "arm/left", "arm/right"}
    assert graph.components["base"].outputs == {"odom"}


def test_a_name_that_no_log_has_stands_for_itself():
    assert topics_named("lost", KEYS, TypeRegistry([])) == {"lost"}
