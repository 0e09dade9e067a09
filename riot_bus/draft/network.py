"""Observation of a plain Zenoh system on a router, with a short recording."""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from riot_bus.config.endpoints import parse_endpoint
from riot_bus.draft.command_draft import command_draft
from riot_bus.draft.graph_draft import Seen
from riot_bus.draft.process_facts import facts_of
from riot_bus.draft.recording import read_log
from riot_bus.graph.history import graph_from
from riot_bus.graph.model import ConnectedComponent, Graph
from riot_bus.graph.processes import command
from riot_bus.graph.supplement import supplemented, without_listener
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.session import environment_of_others
from riot_bus.zenoh.session_config import control_id, is_control

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.config.endpoints import Endpoint
    from riot_bus.draft.init_options import InitOptions
    from riot_bus.draft.model import CommandDraft
    from riot_bus.graph.survey import Started, Survey

_LINK = "link"
_RIOT, _WATCHES = frozenset({"riot", "riot-bus", "riot_bus"}), frozenset({"ctl", "graph", "record", "scan"})
_REST_S, _WITHIN_S = 0.5, 60.0
"""Seconds of a survey, in which a router notices that our recorder has left, and the longest wait for a graph that
describes a look after that: on a busy machine, the router looks every half a minute."""


def look_at_network(options: InitOptions) -> Seen:
    """Return what can be observed on a router within some seconds; its messages are recorded meanwhile.

    Raises:
        ConfigError: The recording cannot be written, or there are several routers.
        EnvironmentFaultError: No router answers at the endpoint.
    """
    from riot_bus.graph.survey import survey

    endpoint, config = options.endpoint, options.config
    registry = TypeRegistry(load_adapters())
    with tempfile.TemporaryDirectory(prefix="riot-init-") as folder:
        path = options.record or Path(folder, "look.mcap")
        senders = _record(path, options)
        # The types in the recording come from a riot.toml here, which is to be replaced, so they are not learnt.
        counts, topics, skipped, _ = read_log(path, registry, learn=False)
    seen = survey(endpoint, registry, seconds=_REST_S, config={**config, "id": control_id()})
    found, endpoints = _of_router(endpoint, options.router, config)
    graph, started = (found, seen.started) if found is not None else _of_others(endpoint, seen)
    graph = replace(graph, components=tuple(_of_system(graph.components, started)))
    graph, listener = without_listener(graph)
    graph = supplemented(graph, counts, senders=senders, tokens=seen.announcements, complete=found is not None)
    commands = _commands(started, [parse_endpoint(each) for each in (endpoint, *endpoints)])
    return Seen(graph, topics, commands, skipped, redacted(endpoint), listener=listener)


def _record(path: Path, options: InitOptions) -> dict[str, set[str]]:
    """Record a network for some time; return the ids of those who timestamped messages, by key."""
    from riot_bus.record.options import CaptureOptions
    from riot_bus.record.service import CaptureService

    capture = CaptureOptions(
        endpoint=options.endpoint,
        config={**options.config, "id": control_id()},  # else it would be one of the components
        output=path,
        overwrite=options.force,
        duration=options.seconds,
        graph=False,
        control=False,
    )
    with CaptureService(capture) as service:
        service.wait()
        return service.senders()


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
