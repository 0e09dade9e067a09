"""What a recording shows: message rates, the codecs that read all payloads of a topic, and the graph in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from riot_bus.draft.graph_draft import Seen
from riot_bus.draft.model import TopicDraft
from riot_bus.graph.history import replay
from riot_bus.graph.model import ConnectedComponent, Graph
from riot_bus.graph.supplement import supplemented, without_listener
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.layout import GRAPH
from riot_bus.log.reader import LogReader
from riot_bus.plugins import CODECS
from riot_bus.types.model import ROOT, MessageType
from riot_bus.types.raw_type import OpaqueType
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, PayloadError, RiotError
from riot_bus.vocabulary.message import Message

_MOST_READ, _LARGEST_READ = 200, 1 << 20
"""Largest number of payloads read for each topic, and their largest size: a few show which codecs fit."""
_MOST_TOPICS = 2000  # drafts are for people to edit; the memory stays bounded if keys are invented
_TEXT = "json"


def look_at_log(path: Path) -> Seen:
    """Return what a recording shows.

    Raises:
        ConfigError: The file is missing or not MCAP.
    """
    registry = TypeRegistry(load_adapters())
    counts, topics, skipped, graph = read_log(path, registry, learn=True)
    if not graph.components:  # one for each segment that the recording names, as nothing more is known
        segments = sorted({segment for _, segment in counts if segment})
        graph = Graph.of([ConnectedComponent(each, f"segment {each}", name=each) for each in segments], (), (), ())
    graph, listener = without_listener(graph)
    graph = supplemented(graph, counts, complete=False)
    why = "a recording does not tell how components are started"
    return Seen(graph, topics, {}, skipped, str(path), no_command=why, listener=listener)


def read_log(
    path: Path, registry: TypeRegistry, *, learn: bool
) -> tuple[Counter[tuple[str, str]], dict[str, TopicDraft], int, Graph]:
    """Return message counts of a log by key and segment, topic drafts, the number of skipped keys, and the graph."""
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


def look_at(messages: Iterable[Message], registry: TypeRegistry) -> tuple[dict[str, TopicDraft], int]:
    """Return what messages show about their topics, by key, and the number of keys skipped because of the limit."""
    codecs = _documents(registry)
    looks: dict[str, _TopicLook] = {}
    skipped: set[str] = set()
    for message in messages:
        if message.key in looks or len(looks) < _MOST_TOPICS:
            look = looks.get(message.key) or looks.setdefault(message.key, _TopicLook(message.key, registry, codecs))
            look.add(message)
        else:
            skipped.add(message.key)
    return {key: looks[key].draft() for key in sorted(looks)}, len(skipped)


def _documents(registry: TypeRegistry) -> list[MessageType]:
    """Return the codecs whose payloads need no definition, without those that cannot be loaded."""
    found: list[MessageType | None] = []
    for name in CODECS.targets():
        with suppress(RiotError):
            found.append(registry.type_named(name))
    return [each for each in found if each is not None and not isinstance(each, OpaqueType)]


class _TopicLook:
    """The messages of one key."""

    def __init__(self, key: str, registry: TypeRegistry, codecs: Sequence[MessageType]) -> None:
        self._key, self._registry = key, registry
        self._type: MessageType | None = None
        self._readable, self._read, self._count = True, 0, 0
        self._fitting = {each.name: each for each in codecs}
        self._documents: set[str] = set()
        self._encodings = Counter[str]()
        self._first = self._last = self._least = self._most = 0

    def add(self, message: Message) -> None:
        """Add a message."""
        size = len(message.payload)
        if not self._count:
            self._first, self._least = message.time, size
        self._count += 1
        self._last, self._least, self._most = message.time, min(self._least, size), max(self._most, size)
        # Publishers may use any text as encoding; usually, a topic has one or two.
        if message.encoding in self._encodings or len(self._encodings) < 8:
            self._encodings[message.encoding] += 1
        if message.kind == "put" and self._read < _MOST_READ and size <= _LARGEST_READ:
            self._read += 1
            self._try(message)

    def _try(self, message: Message) -> None:
        payload = message.payload
        self._type = self._registry.type_of(self._key, payload=payload, encoding=message.encoding)
        self._readable = self._readable and self._type is not None and self._type.opaque(payload) is None
        for name, codec in list(self._fitting.items()):
            try:
                leaves = codec.leaves(payload, elements=1)
            except PayloadError:
                del self._fitting[name]
                continue
            if leaves and leaves[0].path != ROOT:
                self._documents.add(name)

    def draft(self) -> TopicDraft:
        """Return what is known about the topic."""
        fits = tuple(self._fitting) if self._read else ()
        # A few bytes are a valid number in any binary encoding, so only text is recognised without a document.
        clear = [name for name in fits if name in self._documents] or [name for name in fits if fits == (_TEXT,)]
        known = self._type.name if self._type is not None and self._readable else ""
        seconds = (self._last - self._first) / 1e9
        return TopicDraft(
            self._registry.topic(self._key),
            self._key,
            known or (clear[0] if len(clear) == 1 else ""),
            declare=not known and len(clear) == 1,
            fits=fits if not known and len(clear) != 1 else (),
            encodings=tuple(name for name, _ in self._encodings.most_common()),
            count=self._count,
            rate=(self._count - 1) / seconds if seconds > 0 else 0.0,
            sizes=(self._least, self._most),
            read=self._read,
        )
