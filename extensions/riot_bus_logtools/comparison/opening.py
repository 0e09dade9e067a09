"""Logs as recordings to be compared: files or folders of them, or only some topics or a part of the time."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from heapq import merge
from itertools import combinations
from operator import attrgetter
from pathlib import Path

from riot_bus.config.arguments import parse_types
from riot_bus.log.account import LOST, account_of
from riot_bus.log.naming import parse_time
from riot_bus.log.reader import ChannelSource, LogReader
from riot_bus.log.rosbag2 import files_of
from riot_bus.log.tables.plan import is_chosen, log_registry
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.compare import Wishes, compare
from riot_bus_logtools.comparison.options import Extract
from riot_bus_logtools.comparison.proposal import Proposal, propose
from riot_bus_logtools.comparison.recording import Recording
from riot_bus_logtools.comparison.result import LogDifference
from riot_bus_logtools.comparison.tolerances import TopicTolerances


def compare_logs(a: Path, b: Path, wishes: Wishes | None = None, *, extract: Extract | None = None) -> LogDifference:
    """Compare two logs; raises ConfigError as `opened` does."""
    with opened([a, b], extract) as (first, second):
        return compare(first, second, wishes)


def propose_tolerances(paths: Sequence[Path], *, extract: Extract | None = None) -> Proposal:
    """Propose tolerances with which nominal runs are the same, from all pairs of their logs; raises ConfigError."""
    if len(paths) < 2:
        raise ConfigError("tolerances are learnt from two runs or more", hint="riot diff --propose RUN1 RUN2 RUN3")
    with opened(paths, extract) as recordings:
        pairs = list(combinations(recordings, 2))

        def compared(tolerances: TopicTolerances) -> list[LogDifference]:
            return [compare(a, b, Wishes(tolerances=tolerances)) for a, b in pairs]

        return propose([str(path) for path in paths], compared)


@contextmanager
def opened(paths: Sequence[Path], extract: Extract | None = None) -> Iterator[list[Recording]]:
    """Open logs, or folders of a recording's files, that are compared with each other; without an extract, all of them.

    Raises ConfigError if a log cannot be read, or an option names a topic that none of them has.
    """
    extract = extract or Extract()
    with ExitStack() as stack:
        logs = [_Log(path, extract, stack) for path in paths]
        for where, texts in (("--topics", extract.topics), ("--exclude", extract.exclude)):
            for text in texts:
                if not any(log.has(text) for log in logs):
                    names = {source.topic for log in logs for source in log.sources.values()}
                    raise ConfigError(f"no log has a topic {text!r}", where=where, hint=did_you_mean(text, names))
        recordings = []
        for log in logs:
            recordings.append(log.recording())
            stack.callback(recordings[-1].close)
        yield recordings


class _Log:
    """A log that is open."""

    def __init__(self, path: Path, extract: Extract, stack: ExitStack) -> None:
        self._path, self._extract = path, extract
        self._readers = [stack.enter_context(LogReader(file, salvage=extract.salvage)) for file in files_of(path)]
        self._registry: TypeRegistry = log_registry(
            *self._readers, declared=parse_types(extract.types), definitions=extract.definitions
        )
        self.sources: dict[str, ChannelSource] = {}
        for reader in self._readers:
            for source in reader.sources().values():
                if source.role == "delivered":
                    self.sources.setdefault(source.key, source)

    def has(self, text: str) -> bool:
        """Return whether a name or key expression includes one of its topics."""
        return any(is_chosen(source, [text], self._registry) for source in self.sources.values())

    def recording(self) -> Recording:
        """Read the log."""
        extract, registry = self._extract, self._registry
        chosen = {
            key
            for key, source in self.sources.items()
            if (not extract.topics or is_chosen(source, extract.topics, registry))
            and not (extract.exclude and is_chosen(source, extract.exclude, registry))
        }
        begins = [span[0] for reader in self._readers if (span := reader.span()) is not None]
        begin = min(begins, default=0)
        start = None if extract.start is None else parse_time(extract.start, begin, where="--start")
        end = None if extract.end is None else parse_time(extract.end, begin, where="--end")

        def messages(keys: Collection[str] | None) -> Iterator[Message]:
            wanted = chosen if keys is None else chosen & set(keys)
            each = [reader.messages(topics=[*wanted], start=start, end=end) for reader in self._readers]
            merged = each[0] if len(each) == 1 else merge(*each, key=attrgetter("time"))
            return (message for message in merged if message.key in wanted)

        names = {
            key: (registry.topic(key) if source.topic == key else source.topic, source.schema.name)
            for key, source in self.sources.items()
        }
        found = Recording(str(self._path), registry, messages, names=names)
        found.missing += self._missing()
        return found

    def _missing(self) -> Iterator[str]:
        """Yield what could not be read, or was lost when it was recorded."""
        for reader in self._readers:
            if reader.loss:
                yield str(reader.loss)
            accounts = [account_of(note) for note in reader.notes(LOST)]
            lost = accounts[-1].total() if accounts and accounts[-1] is not None else 0
            if lost:
                yield f"{counted(lost, 'message')} lost when it was recorded"
