"""`riot router`: a bus that runs until it is told to stop, then says what happened."""

from __future__ import annotations

import signal
import threading
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from riot_bus.bus.router import Bus, TopicCounts
from riot_bus.errors import ConfigError, DataLossError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path
    from types import FrameType

    from riot_bus.bus.recorder import Recorder
    from riot_bus.types.registry import TypeRegistry

__all__ = ["DEFAULT_SEGMENTS", "RouterOptions", "count_table", "parse_segments", "parse_types", "run_router"]

DEFAULT_SEGMENTS = ("system=tcp/127.0.0.1:7447", "unit=tcp/127.0.0.1:7448")


@dataclass(frozen=True, slots=True)
class RouterOptions:
    """What `riot router` was asked to do, as written on the command line."""

    segments: Sequence[str] = DEFAULT_SEGMENTS
    intercept: Sequence[str] = ()
    interceptors: Sequence[str] = ()
    inject: Path | None = None
    record: Path | None = None
    types: Sequence[str] = ()
    definitions: Sequence[Path] = ()
    seed: int = 0


def parse_segments(texts: Sequence[str]) -> dict[str, list[str]]:
    """Parse `NAME=ENDPOINT[,ENDPOINT...]`; a segment that is named twice has all its endpoints.

    Raises:
        ConfigError: A text is not of this form.
    """
    segments: dict[str, list[str]] = {}
    for text in texts:
        name, equals, rest = text.partition("=")
        endpoints = [endpoint.strip() for endpoint in rest.split(",") if endpoint.strip()]
        if not name or not equals or not endpoints or any("/" not in endpoint for endpoint in endpoints):
            hint = "write NAME=ENDPOINT[,ENDPOINT...], such as unit=tcp/127.0.0.1:7448"
            raise ConfigError(f"{text!r} is not a segment", where="--segment", hint=hint)
        segments.setdefault(name, []).extend(endpoints)
    return segments


def parse_types(texts: Sequence[str]) -> dict[str, str]:
    """Parse `TOPIC=TYPE`.

    Raises:
        ConfigError: A text is not of this form.
    """
    types = {}
    for text in texts:
        topic, equals, type_name = text.rpartition("=")
        if not topic or not equals or not type_name:
            hint = "write TOPIC=TYPE, such as /odom=nav_msgs/msg/Odometry"
            raise ConfigError(f"{text!r} is not a topic and its type", where="--type", hint=hint)
        types[topic] = type_name
    return types


def run_router(options: RouterOptions, *, say: Callable[[str], None], warn: Callable[[str], None]) -> None:
    """Run until SIGINT or SIGTERM, then print counts.

    Args:
        options: What to do.
        say: Prints a line of the result.
        warn: Prints a line of diagnostics.

    Raises:
        ConfigError: An option is wrong.
        EnvironmentFaultError: An endpoint is in use.
        DataLossError: It ran, but messages were lost.
    """
    from riot_bus.pipeline.runner import Pipeline

    segments = parse_segments(options.segments)
    registry = _registry(options)
    interceptors, wanted = _interceptors(options)
    intercept = [registry.key_expression(topic) for topic in wanted]
    pipeline = Pipeline(interceptors, registry=registry)
    with ExitStack() as stack:
        stop = stack.enter_context(_signals())
        stack.callback(pipeline.close)
        recorder = _recorder(options, registry, ros=any(topic.startswith("/") for topic in wanted))
        if recorder is not None:
            stack.callback(recorder.close)
        bus = Bus(
            segments,
            intercept=intercept,
            pipeline=pipeline,
            registry=registry,
            recorder=recorder,
            record=["**"] if recorder else (),
        )
        with bus:
            where = ", ".join(f"segment {name} {' '.join(bus.segment(name).endpoints)}" for name in segments)
            say(f"ready: {where}; intercepting {', '.join(wanted) or 'nothing'}")
            stop.wait()
    for line in count_table(bus.counts()):
        say(line)
    for name, errors in pipeline.errors.items():
        warn(f"interceptor {name} raised {errors.count} times; the messages went on without it. First:\n{errors.first}")
    if losses := bus.losses:
        lost = sum(losses.messages.values()) + sum(losses.recordings.values())
        parts = [f"{lost} messages were lost"] if lost else []
        raise DataLossError("; ".join([*parts, *map(str, losses.links)]), hint="see the column 'lost', by topic")


def count_table(counts: Mapping[str, TopicCounts]) -> list[str]:
    """Return the lines of a table: one row per topic."""
    names = [each.name for each in fields(TopicCounts)]
    rows = [["topic", *names]]
    rows += [[topic, *(str(getattr(each, name)) for name in names)] for topic, each in counts.items()]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(
            [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        )
        for row in rows
    ]


def _registry(options: RouterOptions) -> TypeRegistry:
    from riot_bus.types.registry import TypeRegistry, load_adapters

    declared = parse_types(options.types)
    adapters = load_adapters()
    if options.definitions:
        for adapter in adapters:
            adapter.load(options.definitions)
    return TypeRegistry(adapters, declared=declared)


def _interceptors(options: RouterOptions) -> tuple[list[object], list[str]]:
    from riot_bus.inject.interceptor import Injector
    from riot_bus.inject.plan import read_plan
    from riot_bus.pipeline.loader import load_interceptor
    from riot_bus.selector import parse_selector

    interceptors = [load_interceptor(path) for path in options.interceptors]
    if options.inject is not None:
        interceptors.append(Injector(read_plan(options.inject), seed=options.seed))
    wanted = list(options.intercept)
    for interceptor in interceptors:
        topics = getattr(interceptor, "topics", None)
        if topics is None and not options.intercept:
            name = type(interceptor).__name__
            raise ConfigError(f"interceptor {name} would see nothing", hint="say which keys: --intercept KEYEXPR")
        wanted += [parse_selector(text).topic for text in ([topics] if isinstance(topics, str) else topics or ())]
    return interceptors, list(dict.fromkeys(wanted))


def _recorder(options: RouterOptions, registry: TypeRegistry, *, ros: bool) -> Recorder | None:
    from riot_bus.bus.recorder import Recorder
    from riot_bus.log.writer import LogWriter

    if options.record is None:
        return None
    metadata = {"seed": str(options.seed), "segments": " ".join(options.segments)}
    if options.inject is not None:
        metadata["plan"] = options.inject.read_text(encoding="utf-8")
    writer = LogWriter(options.record, registry=registry, metadata=metadata, profile="ros2" if ros else None)
    return Recorder(writer, topic=registry.topic)


@contextmanager
def _signals() -> Iterator[threading.Event]:
    """Give an event that SIGINT and SIGTERM set; does nothing outside of the main thread."""
    stop = threading.Event()

    def handler(number: int, frame: FrameType | None) -> None:
        stop.set()

    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    former = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, action in former.items():
            signal.signal(number, action)
