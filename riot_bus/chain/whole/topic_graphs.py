"""The graph of the topics that components read and write, as riot.toml declares it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus.system.system_file import SystemFile
from riot_bus.types.registry import TypeRegistry


def topics_named(name: str, keys: Mapping[str, str], registry: TypeRegistry) -> frozenset[str]:
    """Return the topics of logs that a name or key expression matches; the name itself if it matches none."""
    found = {topic for topic, key in keys.items() if name == topic or registry.matches(name, key)}
    return frozenset(found or {name})


def declared_graph(file: SystemFile, keys: Mapping[str, str], registry: TypeRegistry) -> TopicGraph:
    """Return the topic graph that riot.toml declares, with external components, which close loops."""

    def named(names: Iterable[str]) -> frozenset[str]:
        return frozenset().union(*(topics_named(name, keys, registry) for name in names))

    return TopicGraph(
        {
            name: ComponentTopics(named(component.inputs), named(component.outputs), "riot.toml")
            for name, component in file.components.items()
        }
    )
