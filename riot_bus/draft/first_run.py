"""A first start of components, each on a separate segment, to see which of them work, and what they read and write."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.draft.recording import look_at
from riot_bus.graph.model import Edge, Graph, Topic
from riot_bus.pipeline.runner import Pipeline
from riot_bus.processes.launcher import Launcher
from riot_bus.system.system_file import RunPace
from riot_bus.trial.setup import TrialSetup
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from riot_bus.draft.graph_draft import Seen
    from riot_bus.draft.model import TopicDraft
    from riot_bus.pipeline.event import Event
    from riot_bus.processes.launcher import ComponentProcess
    from riot_bus.trial.context import Context
    from riot_bus.types.capabilities import Role
    from riot_bus.vocabulary.message import Message

_MOST_KEYS = 1000  # each is declared as a publisher with a listener, once for every component
_MOST_MESSAGES, _MOST_BYTES = 20_000, 1 << 26  # 100 topics of the 200 payloads that `recording` reads; 64 MiB


@dataclass(frozen=True, slots=True)
class FirstRun:
    """Behaviour of components when they were started.

    Attributes:
        reads: By component, the keys that it has subscribed to, out of those asked for and those published.
        writes: By component, the keys that it has published on.
        failed: By component, the reason why it does not work.
        topics: By key, what the messages reveal about the topic.
    """

    reads: Mapping[str, Collection[str]] = field(default_factory=dict)
    writes: Mapping[str, Collection[str]] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    topics: Mapping[str, TopicDraft] = field(default_factory=dict)


class _Tap:
    """An interceptor that keeps the first messages."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self._bytes = 0

    def message(self, event: Event) -> None:
        size = len(event.message.payload)
        if len(self.messages) < _MOST_MESSAGES and self._bytes + size <= _MOST_BYTES:
            self.messages.append(event.message)
            self._bytes += size


def first_run(context: Context, names: Sequence[str], *, keys: Collection[str], seconds: float) -> FirstRun:
    """Start components and watch them; their messages reach no other system.

    They may have subscribed to `keys`, too, and are watched for so many seconds after all have connected.
    """
    failed: dict[str, str] = {}
    tap = _Tap()
    pipeline = Pipeline([tap], registry=context.registry)
    with (
        tempfile.TemporaryDirectory(prefix="riot-init-") as folder,
        Launcher() as launcher,
        TrialSetup(context, launcher, Path(folder), segments=(), intercept=["**"], pipeline=pipeline) as setup,
    ):
        for name in names:
            try:
                setup.start(name, seed=0, pace=RunPace(duration=seconds))
            except EnvironmentFaultError as error:
                failed[name] = error.message
        started = setup.processes.started
        failed |= _not_connected(setup)
        setup.processes.wait(started, timeout=seconds)  # less long if all end
        failed |= {name: _how_ended(process) for name, process in started.items() if process.status}
        flows = [each for each, count in setup.network.bus.flows().items() if count]
        asked = sorted({*keys, *(key for key, _ in flows)})[:_MOST_KEYS]
        reads = {
            name: set(asked) - set(setup.network.bus.wait_subscribed(name, asked, timeout=0.2))
            for name, process in started.items()
            if asked and process.status is None
        }
    writes = {name: {key for key, segment in flows if segment == name} for name in started}
    return FirstRun(reads, writes, failed, look_at(tap.messages, context.registry)[0])


def with_run(seen: Seen, run: FirstRun, sessions: Mapping[str, str]) -> Seen:
    """Return facts about a system, completed by what its components did when started; a pure function.

    `sessions` has the name of the component by the id of its session.
    """
    first = {name: zid for zid, name in reversed(list(sessions.items()))}
    homes = {each.zid: each.segment for each in seen.graph.components}

    def edges(role: Role, used: Mapping[str, Iterable[str]]) -> list[Edge]:
        return [
            Edge(key, role, homes.get(first[name], ""), first[name], evidence=("started",))
            for name, keys in used.items()
            for key in keys
        ]

    new = [*edges("subscribes", run.reads), *edges("publishes", run.writes)]
    told = {(each.topic, each.role) for each in new}
    known = {each.identity for each in new}
    kept = [e for e in seen.graph.edges if (e.zid or (e.topic, e.role) not in told) and e.identity not in known]
    topics = {key: Topic(key, each.topic) for key, each in run.topics.items()}
    topics |= {each.key: each for each in seen.graph.topics}
    commands = {
        zid: replace(each, missing=(*each.missing, f"what makes it work when riot starts it: {why}"))
        if (why := run.failed.get(sessions.get(zid, "")))
        else each
        for zid, each in seen.commands.items()
    }
    graph = Graph.of(seen.graph.components, topics.values(), [*kept, *new], seen.graph.unknown)
    return replace(seen, graph=graph, topics={**run.topics, **seen.topics}, commands=commands)


def _not_connected(setup: TrialSetup) -> dict[str, str]:
    """Wait until all have connected, ended or timed out; return those that have not connected, and why."""
    begin, components, started = time.monotonic(), setup.context.file.components, setup.processes.started
    results: dict[str, str] = {}  # empty for those that have connected
    while missing := started.keys() - results.keys():
        for name in sorted(missing):
            timeout = components[name].ready.timeout
            if setup.network.connected(name):
                results[name] = ""
            elif not setup.processes.alive([name]):
                results[name] = _how_ended(started[name])
            elif time.monotonic() - begin > timeout:
                results[name] = f"it has not connected to {{endpoint}} within {timeout:g} s"
        time.sleep(0.02)  # how late a connection is noticed
    return {name: why for name, why in results.items() if why}


def _how_ended(process: ComponentProcess) -> str:
    words = process.errors().strip().splitlines()
    last = f": {words[-1][-300:]}" if words else ""
    return f"it ended with status {process.status}{last}"
