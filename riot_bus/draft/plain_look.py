"""Observation of a plain Zenoh system: on a router, with a short recording, or from a recording only."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from riot_bus.config.endpoints import parse_endpoint
from riot_bus.draft.command_draft import command_draft
from riot_bus.draft.plain_draft import PlainFacts
from riot_bus.draft.process_facts import facts_of
from riot_bus.draft.topic_look import look_at
from riot_bus.graph.history import graph_from, replay
from riot_bus.graph.model import ConnectedComponent, Graph
from riot_bus.graph.processes import command
from riot_bus.graph.supplement import supplemented, without_listener
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.layout import GRAPH
from riot_bus.log.reader import LogReader
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.session import environment_of_others
from riot_bus.zenoh.session_config import control_id, is_control

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.config.endpoints import Endpoint
    from riot_bus.draft.command_draft import CommandDraft
    from riot_bus.draft.topic_look import TopicDraft
    from riot_bus.graph.survey import Started, Survey
    from riot_bus.vocabulary.message import Message

_SURVEY_S, _LINK = 0.5, "link"
_RIOT, _WATCHES = frozenset({"riot", "riot-bus", "riot_bus"}), frozenset({"ctl", "graph", "record", "scan"})
_REST_S, _WITHIN_S = 0.5, 60.0
"""Seconds that a router is given to notice that our recorder has left, and the longest wait for a graph that describes
a look after that: on a busy machine, the router looks every half a minute."""


def look_at_log(path: Path) -> PlainFacts:
    """Return what a recording shows.

    Raises:
        ConfigError: The file is missing or not MCAP.
    """
    registry = TypeRegistry(load_adapters())
    counts, topics, skipped, graph = _read(path, registry, learn=True)
    graph, listener = without_listener(graph if graph.components else _segments_alone(counts))
    graph = supplemented(graph, counts, complete=False)
    why = "a recording does not tell how components are started"
    return PlainFacts(graph, topics, {}, skipped, str(path), no_command=why, listener=listener)


def look_at_network(
    endpoint: str, *, seconds: float, record: Path | None, config: Mapping[str, Any], router: str | None, force: bool
) -> PlainFacts:
    """Return what can be observed on a router within some seconds; its messages are recorded meanwhile.

    Args:
        endpoint: Endpoint of the router.
        seconds: Time to look, in seconds.
        record: Path at which the recording is kept; None to drop it.
        config: Further Zenoh configuration.
        router: Name of the router, if it is one of riot's and there are several.
        force: Whether to replace an existing recording.

    Raises:
        ConfigError: The recording cannot be written, or there are several routers.
        EnvironmentFaultError: No router answers at the endpoint.
    """
    from riot_bus.graph.survey import survey

    registry = TypeRegistry(load_adapters())
    with tempfile.TemporaryDirectory(prefix="riot-init-") as folder:
        path = record or Path(folder, "look.mcap")
        senders = _record(path, endpoint, config, seconds, force=force)
        # The types in the recording come from a riot.toml here, which is to be replaced, so they are not learnt.
        counts, topics, skipped, _ = _read(path, registry, learn=False)
    seen = survey(endpoint, registry, seconds=_SURVEY_S, config={**config, "id": control_id()})
    found, endpoints = _of_router(endpoint, router, config)
    graph, started = (found, seen.started) if found is not None else _of_others(endpoint, seen)
    graph = replace(graph, components=tuple(_of_system(graph.components, started)))
    graph, listener = without_listener(graph)
    graph = supplemented(graph, counts, senders=senders, tokens=seen.announcements, complete=found is not None)
    commands = _commands(started, [parse_endpoint(each) for each in (endpoint, *endpoints)])
    return PlainFacts(graph, topics, commands, skipped, redacted(endpoint), listener=listener)


def _record(
    path: Path, endpoint: str, config: Mapping[str, Any], seconds: float, *, force: bool
) -> dict[str, set[str]]:
    """Record a network for some time; return the ids of those who timestamped messages, by key."""
    from riot_bus.record.options import CaptureOptions
    from riot_bus.record.service import CaptureService

    hidden = {**config, "id": control_id()}  # else it would be one of the components
    options = CaptureOptions(
        endpoint=endpoint, config=hidden, output=path, overwrite=force, duration=seconds, graph=False, control=False
    )
    with CaptureService(options) as service:
        service.wait()
        return service.senders()


def _read(
    path: Path, registry: TypeRegistry, *, learn: bool
) -> tuple[Counter[tuple[str, str]], dict[str, TopicDraft], int, Graph]:
    """Return message counts of a log by key and segment, topic drafts, the number of skipped keys, and the graph.

    Args:
        path: Path of the log.
        registry: Registry of types.
        learn: Whether the registry learns the types that the log names.
    """
    counts = Counter[tuple[str, str]]()

    def counted(messages: Iterable[Message]) -> Iterator[Message]:
        for message in messages:
            counts[message.key, message.segment] += 1
            yield message

    with LogReader(path) as reader:
        if learn:
            learn_types(reader, registry)
        topics, skipped = look_at(counted(bus_messages(reader, registry)), registry)
        return counts, topics, skipped, _lasting(reader)


def _lasting(reader: LogReader) -> Graph:
    """Return the longest-lasting one of a log's graphs with most components; an empty graph if there is none.

    Components come and go, and so do temporary listeners.
    """
    try:
        graphs = list(replay(reader.notes(GRAPH)))
    except ValueError as error:
        raise ConfigError(f"the recorded graph is damaged ({error})", where=reader.path) from error
    lasted = Counter[Graph]()
    for (begin, graph), (end, _) in pairwise([*graphs, (reader.latest, Graph())]):
        lasted[graph] += max(0, end - begin)
    return max(lasted, key=lambda graph: (len(graph.components), lasted[graph]), default=Graph())


def _segments_alone(counts: Iterable[tuple[str, str]]) -> Graph:
    """Return a graph with one component for each segment that a recording names, as nothing more is known."""
    segments = sorted({segment for _, segment in counts if segment})
    return Graph.of([ConnectedComponent(each, f"segment {each}", name=each) for each in segments], (), (), ())


def _of_router(endpoint: str, name: str | None, config: Mapping[str, Any]) -> tuple[Graph | None, list[str]]:
    """Return the graph of riot's router at an endpoint, None if there is none, and the endpoints of its segments."""
    from riot_bus.control.remote import Remote

    with Remote(endpoint, name, config=config) as remote:
        if name is None and not remote.find():
            return None, []
        begin = time.monotonic()
        while True:
            time.sleep(_REST_S)
            document = remote.ask("graph")
            asked, age, graph = time.monotonic(), document.get("age"), graph_from(document)
            segments = remote.ask("status")["segments"]
            present = _present(segments)
            known = {(each.segment, each.zid): each for each in graph.components if each.segment and each.mode != _LINK}
            recent = isinstance(age, float) and asked - age > begin + _REST_S  # else its receivers may be our recorder
            if (recent and known.keys() == present.keys()) or asked - begin > _WITHIN_S:
                break
    others = [each for each in graph.components if not each.segment or each.mode == _LINK]
    components = [*(known.get(who, each) for who, each in present.items()), *others]
    endpoints = [str(each) for row in segments.values() for each in row["endpoints"]]
    return replace(graph, components=tuple(components)), endpoints


def _present(segments: Mapping[str, Any]) -> dict[tuple[str, str], ConnectedComponent]:
    """Return who is connected now, as a router's status has it."""
    return {
        (name, str(each["zid"])): ConnectedComponent(name, str(each["zid"]), str(each["mode"]), str(each["name"]))
        for name, row in segments.items()
        for each in row["components"]
    }


def _of_others(endpoint: str, seen: Survey) -> tuple[Graph, Mapping[str, Started]]:
    """Return the components on a router that is not riot's: as it reports, else from the sockets of this machine."""
    from riot_bus.graph.survey import started_at

    modes, started = {zid: mode for zid, mode in seen.modes.items() if not is_control(zid)}, dict(seen.started)
    if not modes:
        started = {f"process {each.pid}": each for each in started_at(endpoint)}
        modes = dict.fromkeys(started, "")
    return Graph.of([ConnectedComponent("", zid, mode) for zid, mode in modes.items()], (), (), ()), started


def _of_system(
    components: Iterable[ConnectedComponent], started: Mapping[str, Started]
) -> Iterator[ConnectedComponent]:
    """Yield the components that do not only watch, with what is known of their processes."""
    for each in components:
        process = started.get(each.zid)
        if process is None:
            yield each
        elif not _only_watches(process.command):
            yield replace(each, pid=process.pid, command=each.command or command(process.pid))


def _only_watches(command: Sequence[str]) -> bool:
    """Return whether a command is one of riot's that watches a network, and so belongs to no system."""
    words = [PurePath(word).name for word in command]
    return any(first in _RIOT and second in _WATCHES for first, second in pairwise(words))


def _commands(started: Mapping[str, Started], endpoints: Sequence[Endpoint]) -> dict[str, CommandDraft]:
    """Return how processes are started, by the ids of their sessions."""
    ports = {each.port for each in endpoints if each.port}
    files = [f"{each.protocol}/{each.address}" for each in endpoints if not each.port]
    ours, taken = environment_of_others(), dict[str, str]()
    return {
        zid: command_draft(
            facts_of(each, ports), ports=ports, endpoints=files, ours=ours, python=sys.executable, taken=taken
        )
        for zid, each in started.items()
    }
