"""Preparation of a playback from its options: logs, topics, time line, interceptors; nothing is published yet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

from riot_bus.config.arguments import parse_types
from riot_bus.log.naming import parse_time
from riot_bus.log.playback.ahead import AheadSource
from riot_bus.log.playback.recall import RecallingSource
from riot_bus.log.playback.sources import LogSource, MergedSource, PipedSource, Source
from riot_bus.log.reader import LogReader
from riot_bus.log.rosbag2 import files_of
from riot_bus.pipeline.runner import Pipeline
from riot_bus.play.options import PlayOptions
from riot_bus.play.topic_selection import TopicSelection, cast
from riot_bus.router.interception import topics_of
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.message import Message


class PlaybackPlan:
    """Logs, topics and interceptors of a playback.

    Attributes:
        source: Messages after the interceptors.
        origin: Beginning of the logs, nanoseconds, before any start offset.

    Raises:
        ConfigError: A log, option, plan or interceptor is not usable.
    """

    def __init__(self, options: PlayOptions) -> None:
        options.check()
        self.warnings: list[str] = []
        self._stack = ExitStack()
        with ExitStack() as stack:
            self._recordings = [
                [
                    stack.enter_context(LogReader(file, salvage=options.salvage, limits=options.limits))
                    for file in files_of(log)
                ]
                for log in options.logs
            ]
            self.readers = [reader for recording in self._recordings for reader in recording]
            adapters = load_adapters()
            declared = parse_types(options.types)
            self.registry = TypeRegistry(adapters, declared=declared, definitions=options.definitions)
            self.cast: TopicSelection = cast([reader.recorded_topics() for reader in self.readers], options, adapters)
            self._learn_types()
            merged = self._merged(options)
            self._ahead = AheadSource(merged)
            stack.callback(self._ahead.close)
            self.pipeline = self._pipeline(options)
            self.source: Source = self._ahead if self.pipeline is None else PipedSource(self._ahead, self.pipeline)
            self._stack = stack.pop_all()

    def finish(self) -> None:
        """Stop reading; `losses` is final from then on."""
        self._ahead.close()

    def close(self) -> None:
        """Close the logs; safe to call twice."""
        self._stack.close()

    def name(self, key: str) -> str:
        """Return the topic name of a key that is played."""
        return self.cast.names.get(key) or self.registry.topic(key)

    def losses(self) -> dict[str, str]:
        """Return what could not be read so far, by log."""
        return {reader.path: str(reader.loss) for reader in self.readers if reader.loss}

    @property
    def hint(self) -> str | None:
        """What to do about damaged logs, None if nothing."""
        return next((reader.loss.hint for reader in self.readers if reader.loss.hint), None)

    def _learn_types(self) -> None:
        for key, topic in self.cast.topics.items():
            for name in {key, self.cast.names[key], topic.name}:
                if topic.schema.name or topic.encoding:
                    self.registry.add_schema(name, topic.schema, topic.encoding)

    def _merged(self, options: PlayOptions) -> Source:
        spans = {id(reader): span for reader in self.readers if (span := reader.span()) is not None}
        begins = [
            min((spans[id(reader)][0] for reader in recording if id(reader) in spans), default=None)
            for recording in self._recordings
        ]
        self.origin = min((begin for begin in begins if begin is not None), default=0)
        shifts = {
            id(reader): self.origin - begin if options.align and begin is not None else 0
            for recording, begin in zip(self._recordings, begins, strict=True)
            for reader in recording
        }
        latched = {key: offer.depth for key, offer in self.cast.offers.items() if offer.depth is not None}
        sources: list[Source] = []
        keeping: list[Source] = []
        for reader, keys in zip(self.readers, self.cast.keys, strict=True):
            if id(reader) not in spans:
                continue
            shift = shifts[id(reader)]
            if keys:
                sources.append(LogSource(reader, keys, shift=shift))
            kept = {recorded: key for recorded, key in keys.items() if key in latched}
            if kept:
                keeping.append(LogSource(reader, kept, shift=shift))
        start = self.origin + int(options.start_offset * 1e9)
        end: int | None = None
        if options.duration is not None:
            end = start + int(options.duration * 1e9)
        elif options.until is not None:
            end = parse_time(options.until, self.origin, where="--until")
            if end <= start:
                raise ConfigError(f"{options.until} is not after the beginning", where="--until")
        last = max((source.end for source in sources), default=start)
        if start > last:
            text = (
                f"there is nothing after {options.start_offset:g} s: the logs are {(last - self.origin) / 1e9:g} s long"
            )
            raise ConfigError(text, where="--start-offset")
        merged = MergedSource(sources, start=start, end=end)
        if not keeping:
            return merged

        def before(since: int, until: int) -> Iterator[Message]:
            return MergedSource(keeping, start=since, end=until).messages()

        return RecallingSource(merged, before, latched, origin=self.origin)

    def _pipeline(self, options: PlayOptions) -> Pipeline | None:
        if not options.interceptors and options.inject is None:
            return None
        from riot_bus.inject.injection_plan import InjectionPlan
        from riot_bus.interceptors.parsing import build_all

        found = build_all(options.interceptors, seed=options.seed)
        if options.inject is not None:
            found.append(InjectionPlan.read(options.inject, seed=options.seed).injector)
        for each in found:
            for topic in topics_of(each) or ():
                if not any(self.registry.matches(topic, key) for key in self.cast.offers):
                    names = {self.cast.names[key] for key in self.cast.offers}
                    hint = did_you_mean(topic, names)
                    self.warnings.append(f"nothing is played on {topic!r}, which an interceptor wants; {hint}")
        return Pipeline(found, registry=self.registry, start=self.origin)
