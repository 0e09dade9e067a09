"""Writes fields of a log as a table: CSV or Parquet, one row per message, by time."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.log.engine.limits import DEFAULT_LIMITS
from riot_bus.log.loss import Loss
from riot_bus.log.reader import LogReader
from riot_bus.log.tables.plan import NOTHING, log_registry, plan_columns
from riot_bus.log.tables.table import Columns, column_parts
from riot_bus.new_file import new_file
from riot_bus.types.bulk import gather, join
from riot_bus.types.capabilities import GathersFields
from riot_bus.types.payloads import Gathered
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, did_you_mean, require_package
from riot_bus_logtools.export.csv_file import Kind, Rows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from riot_bus.types.registry import TypeRegistry
    from riot_bus_logtools.export.csv_file import CsvWriter
    from riot_bus_logtools.export.parquet_file import ParquetTableWriter

    TableWriter = CsvWriter | ParquetTableWriter


@dataclass(frozen=True, slots=True)
class Exported:
    """Result of an export.

    Attributes:
        values: Number of messages with a value, by column.
    """

    rows: int
    values: dict[str, int] = field(default_factory=dict)
    loss: Loss = field(default_factory=Loss)


def export_table(
    log: Path | str,
    selectors: Sequence[str],
    out: Path | str,
    *,
    start: int | None = None,
    end: int | None = None,
    force: bool = False,
    registry: TypeRegistry | None = None,
    memory: int = DEFAULT_LIMITS.held,
    salvage: bool = False,
    raw: bool = False,
) -> Exported:
    """Write fields of a log's delivered messages as a table.

    Each message with a selected field becomes one row, ordered by time; columns of other topics are empty in it. The
    file gets its name when it is complete.

    Arguments are as for `riot_bus.log.iter_columns`; `raw` texts are written to CSV unchanged, even those that a
    spreadsheet or a terminal would obey.

    Raises:
        ConfigError: The file exists or is of another kind, or a selector does not fit the log.
        MissingExtraError: pyarrow is not installed.
        EnvironmentFaultError: The file cannot be written.
    """
    out = Path(out)
    make = _writer_for(out, raw=raw)
    with LogReader(log, salvage=salvage) as reader, new_file(out, force=force, source=Path(log)) as temporary:
        registry = log_registry(reader) if registry is None else registry
        kinds = _kinds(reader, selectors, registry)
        parts = column_parts(reader, selectors, start=start, end=end, memory=memory, registry=registry)
        try:
            return _write_all(reader, parts, kinds, str(temporary), make)
        except OSError as error:
            raise EnvironmentFaultError(f"cannot write: {error.strerror or error}", where=str(out)) from error


def _write_all(
    reader: LogReader,
    parts: Iterable[Columns],
    kinds: dict[str, Kind],
    path: str,
    make: Callable[[str, dict[str, Kind]], TableWriter],
) -> Exported:
    names = _names(list(kinds))
    counts = dict.fromkeys(names.values(), 0)
    rows = 0
    writer = make(path, {names[selector]: kind for selector, kind in kinds.items()})
    try:
        topics = {source.key: source.topic for source in reader.sources().values()}
        for batch in _batches(parts, topics):
            writer.write(batch)
            rows += len(batch.times)
            for name, valid in zip(counts, batch.valid, strict=True):
                counts[name] += int(np.count_nonzero(valid))
        writer.close()
    except BaseException:
        with suppress(OSError):
            writer.close()
        raise
    return Exported(rows, counts, reader.loss)


def _writer_for(out: Path, *, raw: bool) -> Callable[[str, dict[str, Kind]], TableWriter]:
    if out.suffix == ".csv":
        from riot_bus_logtools.export.csv_file import CsvWriter

        return partial(CsvWriter, raw=raw)
    if out.suffix == ".parquet":
        from riot_bus_logtools.export.parquet_file import ParquetTableWriter

        require_package("pyarrow", "export")
        return ParquetTableWriter
    hint = did_you_mean(out.suffix, (".csv", ".parquet"))
    raise ConfigError(f"unknown kind of file {out.suffix!r}", where=str(out), hint=hint)


def _names(selectors: Sequence[str]) -> dict[str, str]:
    """Return the names of columns: selectors without their condition, where that is still unique."""
    short = {text: text.partition(" where ")[0].strip() for text in selectors}
    twice = {name for name in short.values() if list(short.values()).count(name) > 1}
    return {text: text if name in twice else name for text, name in short.items()}


def _kinds(reader: LogReader, selectors: Sequence[str], registry: TypeRegistry) -> dict[str, Kind]:
    """Return what each column will hold; an extra pass reads the payloads where only they can tell."""
    wishes, feeds = plan_columns(reader, selectors, registry)
    seen: dict[str, set[Kind]] = {wish.text: set() for wish in wishes}
    unknown: set[str] = set()
    for feed in feeds:
        for wish in (wishes[place] for place in feed.wishes):
            kind = feed.kind
            if kind is not None and isinstance(kind, GathersFields):
                dtype = gather(kind, NOTHING, wish.path).values.dtype
                seen[wish.text].add("text" if dtype == np.object_ else dtype.name)
            else:
                unknown.add(wish.text)
    for part in column_parts(reader, sorted(unknown), registry=registry) if unknown else ():
        for text, column in part.items():
            seen[text] |= _kinds_of(column.values[column.valid])
    return {text: _common(kinds) for text, kinds in seen.items()}


def _kinds_of(values: NDArray[Any]) -> set[Kind]:
    if values.dtype != np.object_:
        return {values.dtype.name} if len(values) else set()
    types = set(map(type, values.tolist()))
    return {"bytes" if types == {bytes} else "text"} if types else set()


def _common(kinds: set[Kind]) -> Kind:
    """Return a kind that can hold all of these; integers above 2^53 mixed with floats lose precision."""
    if len(kinds) == 1:
        return next(iter(kinds))
    if not kinds:
        return "float64"
    if kinds <= {"text", "bytes", "bool"}:
        return "text"
    dtypes = [np.dtype(kind) for kind in kinds - {"text", "bytes", "bool"}]
    return "text" if len(dtypes) < len(kinds) else np.result_type(*dtypes).name


def _batches(parts: Iterable[Columns], topics: dict[str, str]) -> Iterable[Rows]:
    pending: list[Rows] = []
    count = 0
    for part in parts:
        pending.append(_merged(part, topics))
        count += len(pending[-1].times)
        if count >= 1 << 16:  # rows of a row group in Parquet, which would compress badly if small
            yield _joined(pending)
            pending, count = [], 0
    if pending:
        yield _joined(pending)


def _merged(part: Columns, topics: dict[str, str]) -> Rows:
    """Put the fields of a message into one row."""
    columns = list(part.values())
    order, first = np.unique(np.concatenate([column.order for column in columns]), return_index=True)
    times = np.concatenate([column.times for column in columns])[first]
    published = np.concatenate([column.publish_times for column in columns])[first]
    names = [_topics_of(column.keys, column.key, topics) for column in columns]
    values, valid = [], []
    by_time = np.lexsort((order, times))
    for column in columns:
        places = np.searchsorted(order, column.order)
        here = np.zeros(len(order), column.values.dtype)
        there = np.zeros(len(order), np.bool_)
        here[places], there[places] = column.values, column.valid
        values.append(here[by_time])
        valid.append(there[by_time])
    return Rows(times[by_time], published[by_time], np.concatenate(names)[first][by_time], values, valid)


def _topics_of(keys: tuple[str, ...], key: NDArray[np.uint16], topics: dict[str, str]) -> NDArray[Any]:
    names = np.empty(len(keys), np.object_)
    names[:] = [topics.get(each, each) for each in keys]
    return names[key] if len(keys) else np.empty(0, np.object_)


def _joined(parts: Sequence[Rows]) -> Rows:
    if len(parts) == 1:
        return parts[0]
    columns = [
        join([Gathered(part.values[place], part.valid[place]) for part in parts])
        for place in range(len(parts[0].values))
    ]
    return Rows(
        np.concatenate([part.times for part in parts]),
        np.concatenate([part.publish_times for part in parts]),
        np.concatenate([part.topics for part in parts]),
        [column.values for column in columns],
        [column.valid for column in columns],
    )
