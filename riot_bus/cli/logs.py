"""`riot info`, `riot types`, `riot show`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.options import DEFAULT_OUT, Definitions, Format, OutputFormat, Types
from riot_bus.cli.printing import new_table, print_json, print_lines, print_result, print_table
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.log.info import LogInfo
    from riot_bus.log.loss import Loss
    from riot_bus.log.reader import LogReader
    from riot_bus.log.tables.ranges import TopicFields
    from riot_bus.types.fields import FieldType
    from riot_bus.types.listing import TypeListing
    from riot_bus.types.registry import TypeRegistry

_MOST_NAMES = 6
"""Names of values that fit in a line; `--format json` has all."""


def info(
    log: Annotated[Path, typer.Argument(help="An MCAP file, or a folder with one.")],
    *,
    scan: Annotated[
        bool | None,
        typer.Option(
            "--scan/--no-scan",
            help="Read all of the log, or only its summary if that is sound. [default: all of it up to 64 MiB]",
            show_default=False,
        ),
    ] = None,
    fields: Annotated[
        bool, typer.Option("--fields", help="List every field of all topics with its type and the range of its values.")
    ] = False,
    topics: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="List the fields of this topic; repeatable.")
    ] = None,
    type_: Types = None,
    msg: Definitions = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Say what a log holds: topics, types, counts, duration, and what is missing of a damaged one.

    Exit code 3: something cannot be read, or the recorder noted that it lost messages.
    """
    from riot_bus.cli.narrate import bar
    from riot_bus.log.info import log_info
    from riot_bus.log.reader import LogReader

    log = file_of(log)
    with bar("reading") as progress:
        found = log_info(log, scan=scan, progress=progress)
    loss, ranges = found.loss, None
    if fields or topics:
        with LogReader(log) as reader, bar("fields") as progress:
            from riot_bus.log.tables.ranges import field_ranges

            registry = registry_of(reader, type_, msg)
            ranges = field_ranges(reader, topics=topics, registry=registry, progress=progress)
            loss = loss or reader.loss
    if form is OutputFormat.JSON:
        _print_json(found, ranges)
    else:
        _print_info(found)
        if ranges is not None:
            _print_ranges(ranges)
    end_with_loss(loss, found, log)


def types(
    what: Annotated[str | None, typer.Argument(metavar="[LOG|TYPE]", help="A log, or a type such as Odometry.")] = None,
    *,
    topics: Annotated[list[str] | None, typer.Option(metavar="TOPIC", help="These topics alone; repeatable.")] = None,
    type_: Types = None,
    msg: Definitions = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """List the known types, or the fields of a type, or the types and fields of the topics of a log."""
    from dataclasses import asdict

    from riot_bus.types.listing import describe_named
    from riot_bus.types.registry import TypeRegistry, load_adapters

    registry = TypeRegistry(load_adapters(), definitions=msg or ())
    if what is None:
        names = registry.type_names()
        print_result(form, names, names)
    elif _is_file(what):
        _log_types(file_of(Path(what)), topics, type_, msg, form)
    else:
        listing = describe_named(what, registry)
        print_result(form, asdict(listing), [f"{listing.name} ({listing.encoding})", *_field_lines(listing)])


def show(
    what: Annotated[
        Path, typer.Argument(metavar="[LOG|FINDING]", help="A log, or the folder of a finding.")
    ] = DEFAULT_OUT,
    *,
    most: Annotated[int, typer.Option("--most", min=1, help="Maximum number of messages to show.")] = 20,
    type_: Types = None,
    msg: Definitions = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Show the messages of a short log, or the few that a finding needs, and mark what was changed."""
    from riot_bus.chain.base.workspace import open_finding
    from riot_bus.findings.records import FieldsRecord, MinimalRecord, shortest_log
    from riot_bus.log.reader import LogReader
    from riot_bus.log.showing import show_log

    log, notes = what, list[str]()
    if what.is_dir() and ((what / "finding.json").is_file() or (what / "findings").is_dir()):
        folder, _ = open_finding(what)
        log = shortest_log(folder)
        if MinimalRecord.exists(folder):
            notes = MinimalRecord.load(folder).lines()
            if FieldsRecord.exists(folder):
                notes += [f"it needs that {one}" for one in FieldsRecord.load(folder).structure]
    log = file_of(log)
    with LogReader(log) as reader:
        shown = show_log(reader, registry=registry_of(reader, type_, msg), most=most)
        loss = reader.loss
    document = {"log": str(log), **shown.to_json(), "notes": notes}
    print_result(form, document, [str(log), *shown.lines(), *notes])
    end_with_loss(loss, None, log)


def registry_of(reader: LogReader, declared: list[str] | None, definitions: list[Path] | None) -> TypeRegistry:
    """Return a registry with the types of a log, and those that the user names."""
    from riot_bus.config.arguments import parse_types
    from riot_bus.log.tables.plan import log_registry

    return log_registry(reader, declared=parse_types(declared or ()), definitions=definitions or ())


def end_with_loss(loss: Loss, found: LogInfo | None, log: Path) -> None:
    """Raise DataLossError if something of a log could not be read, or was lost when it was recorded."""
    from riot_bus.vocabulary.errors import DataLossError

    lost = found.account.total() if found is not None and found.account is not None else 0
    parts = [str(loss) if loss else "", f"{lost} messages were lost when it was recorded" if lost else ""]
    if any(parts):
        raise DataLossError("; ".join(filter(None, parts)), where=str(log), hint=loss.hint)


def file_of(log: Path) -> Path:
    """Return the file of a log; a folder is accepted if it holds exactly one."""
    from riot_bus.log.rosbag2 import files_of
    from riot_bus.vocabulary.errors import ConfigError

    files = files_of(log)
    if len(files) > 1:
        hint = f"name one, such as {files[0]}, or join them first: riot edit {log} joined.mcap"
        raise ConfigError(f"this folder holds {len(files)} logs", where=str(log), hint=hint)
    return files[0]


def _is_file(text: str) -> bool:
    try:
        return Path(text).exists() or text.endswith(".mcap")
    except (OSError, ValueError):
        return False


def _print_json(found: LogInfo, ranges: list[TopicFields] | None) -> None:
    from dataclasses import asdict

    document: dict[str, Any] = asdict(found)
    document["seconds"] = found.seconds
    document["lossless"] = not found.loss
    if ranges is not None:
        document["fields"] = [asdict(each) for each in ranges]
    print_json(document)


def _print_info(found: LogInfo) -> None:
    from riot_bus.config.arguments import size_text

    columns = ["messages", "Hz", *(["missing"] if any(each.missing for each in found.topics) else [])]
    rows = []
    for each in found.topics:
        counts = [str(each.count), f"{each.rate:.1f}", str(each.missing or 0)]
        rows.append([each.topic, each.type or each.encoding, *counts[: len(columns)]])
    print_table(new_table("topic", "type", numbers=columns), rows)
    begun = f", from {_date(found.start)}" if found.start is not None else ""
    profile = f", profile {found.profile}" if found.profile else ""
    lines = [
        f"{found.seconds:.3f} s, {found.count} messages{begun}",
        f"{size_text(found.size)} in {found.chunks} chunks{profile}, by {found.library or 'unknown'}",
    ]
    shorter = "command" in found.metadata  # the command line says the options shorter; --format json has both
    lines += [f"  {name}: {value}" for name, value in found.metadata.items() if not (shorter and name == "options")]
    for reason, topics in found.account.lost.items() if found.account is not None else ():
        lines += [f"lost when recorded ({reason}): {count} of {name}" for name, count in topics.items()]
    lines += [] if found.scanned else ["from the summary alone; --scan reads all of the file and checks it"]
    print_lines(lines)


def _print_ranges(ranges: list[TopicFields]) -> None:
    more = sum(1 + len(topic.fields) for topic in ranges)
    for topic in ranges:
        unreadable = f", {topic.unreadable} do not decode" if topic.unreadable else ""
        name = f"{topic.topic} ({topic.type or 'unknown type'}): {topic.count} messages{unreadable}"
        typer.echo(f"\n{escape_control_chars(name)}")
        if not topic.fields:
            continue
        rows = []
        for each in topic.fields:
            low, high = (_number(each.low), _number(each.high)) if not each.examples else (_texts(each.examples), "")
            count = f"{each.count}{'+' if each.partial else ''}"
            rows.append((each.path, each.type, count, str(each.nan or ""), low, high))
        print_table(new_table("field", "type", numbers=("values", "NaN", "least", "greatest")), rows, more=more)
        if topic.omitted:
            typer.echo(f"and {topic.omitted} further fields, not looked at")
        if any(each.partial for each in topic.fields):
            typer.echo("+: of the first elements alone")


def _log_types(
    log: Path, topics: list[str] | None, declared: list[str] | None, definitions: list[Path] | None, form: OutputFormat
) -> None:
    from dataclasses import asdict

    from riot_bus.log.reader import LogReader
    from riot_bus.log.tables.plan import topic_types

    with LogReader(log) as reader:
        found = topic_types(reader, registry_of(reader, declared, definitions), topics)
        loss = reader.loss
    lines = list[str]()
    for topic, listing in found:
        lines += [f"{topic}: {listing.name or 'unknown type'} ({listing.encoding})", *_field_lines(listing)]
    print_result(form, [{"topic": topic, **asdict(listing)} for topic, listing in found], lines)
    end_with_loss(loss, None, log)


def _field_lines(listing: TypeListing) -> Iterator[str]:
    width = max((len(each.path) for each in listing.fields), default=0)
    for each in listing.fields:
        length = f"[{each.length}]" if each.length else ""
        told = f"  {each.unit}" if each.unit else ""
        told += f"  {_names(each.names)}" if each.names else ""
        yield f"  {each.path.ljust(width)}  {each.type}{length}{_bounds(each)}{told}"
    if listing.problem:
        yield f"  {listing.problem}"


def _names(names: Sequence[tuple[int, str]]) -> str:
    shown = ", ".join(f"{value} {name}" for value, name in names[:_MOST_NAMES])
    return f"{shown}, {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else shown


def _bounds(field: FieldType) -> str:
    low, high = ("" if each is None else f"{each:g}" for each in (field.low, field.high))
    return f"  {low}..{high}" if low or high else ""


def _texts(examples: list[str]) -> str:
    return " ".join(repr(each) for each in examples)


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else f"{value:.9g}" if isinstance(value, float) else str(value)


def _date(nanoseconds: int) -> str:
    from datetime import UTC, datetime

    try:
        return f"{datetime.fromtimestamp(nanoseconds // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (OverflowError, ValueError, OSError):
        return f"{nanoseconds} ns"
