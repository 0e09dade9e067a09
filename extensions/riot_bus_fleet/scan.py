"""Whole logs judged by a rule: whether the unit would fail, and how near a fleet's logs came to that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riot_bus.chain.base.systems import described
from riot_bus.chain.unit.prediction import alike, column_of, moments_of, rule_text
from riot_bus.findings.records import FindingRecord, MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.info import log_info
from riot_bus.log.reader import LogReader
from riot_bus.log.tables.plan import log_registry
from riot_bus.log.tables.table import Column, Columns, column_parts
from riot_bus.types.latest import FieldPlace, LatestFields, in_words, place_of
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.elements import quantity_of
from riot_bus.vocabulary.errors import RiotError
from riot_bus.vocabulary.order import order_of
from riot_bus.vocabulary.trial import Progress
from riot_bus_fleet.logs.entry import LogEntry
from riot_bus_fleet.logs.near_misses import BINS, FleetScan, LogScan, NearMiss
from riot_bus_fleet.logs.stores import copied


class ScanRule:
    """A rule with everything needed to judge messages by it.

    Args:
        source: Folder of a finding, `region` in it, or a rule file such as its `rule.json`.

    Attributes:
        topics: Topic of each message of the log in which the rule's fields are named.
        keeps: Whether a message that lacks a field leaves its earlier value in force.

    Raises:
        ConfigError: There is no rule.
    """

    def __init__(self, source: Path) -> None:
        folder = source.parent if source.is_file() and source.name == RuleRecord.FILE else source
        # the parent if this is the region
        self._finding = next((one for one in (folder, folder.parent) if FindingRecord.find(one) is not None), None)
        self.record = record = RuleRecord.load(folder)
        self.rule, self._scale, self.keeps = Rule.from_json(record.rule), record.scale, record.keeps
        minimal = MinimalRecord.find(folder)
        self.topics: Sequence[str] = record.topics or (minimal.topics if minimal else ())
        self.names = self.rule.variables
        orders = [order_of(name) for name in self.names]
        ordered = [topic for order in orders if order for topic in (order.first, order.second)]
        fields = [place_of(name, self.topics).topic for name in self.names if not order_of(name)]
        self.read = tuple(dict.fromkeys([*fields, *ordered]))
        self.text = rule_text(self.rule, self.topics)

    def in_words(self, name: str) -> str:
        """Return the name of a field in plain words."""
        return in_words(name, self.topics)

    def registry(self, reader: LogReader | None = None) -> TypeRegistry:
        """Return a registry with the types of the finding's system, those in its own log, and of a log."""
        if self._finding is None:
            return log_registry(reader) if reader else TypeRegistry(load_adapters())
        _, registry = described(self._finding)
        if reader is not None:
            learn_types(reader, registry)
        return registry

    def distance(self, columns: Mapping[str, NDArray[Any]], count: int) -> NDArray[np.float64]:
        """Return the distance of each row from meeting the rule, in nominal spreads; at most 0 where it is met."""
        found = np.empty(count)
        for rows in alike(columns, count):
            found[rows] = self.rule.distance({name: each[rows] for name, each in columns.items()}, self._scale)
        return found


_CANDIDATES = 64
"""Moments kept for each near miss while a log is read: those of one approach are next to one another."""
_APART_NS = 10**9
"""Least time between two near misses of a log, in nanoseconds: closer moments belong to one approach."""


class _Rows(NamedTuple):
    """Moments at which all fields are known, and the number of others at which one was not."""

    times: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]
    unknown: int


class Scanner:
    """Judges logs by one rule."""

    def __init__(self, rule: ScanRule, *, near: int = 3) -> None:
        self._rule, self._near = rule, near

    def scan(self, path: Path, *, place: str = "", robot: str = "") -> LogScan:
        """Judge a log, which may be larger than memory, by the rule; raises ConfigError if the file is not a log."""
        info = log_info(path, scan=False)
        start, end = info.start or 0, info.end or 0
        found = LogScan(place or str(path), robot, start=start)
        profile = np.full(BINS, np.nan)
        kept: list[NearMiss] = []
        with LogReader(path) as reader:
            try:
                for rows in self._rows(reader):
                    distance = self._rule.distance(rows.columns, len(rows.times))
                    bins = np.minimum((rows.times - start) * BINS // max(1, end + 1 - start), BINS - 1)
                    np.fmin.at(profile, bins, distance)
                    kept = self._nearest(kept, rows, distance)
                    found = replace(
                        found,
                        judged=found.judged + len(rows.times),
                        unknown=found.unknown + rows.unknown,
                        holds=found.holds + int(np.count_nonzero(distance <= 0)),
                    )
            except RiotError as error:  # such as a topic that the log does not have
                found = replace(found, problem=error.message)
            else:
                problem = "" if found.judged else "the fields of the rule are never known together"
                found = replace(found, problem=str(reader.loss) if reader.loss else problem)
        nearest: list[NearMiss] = []
        for one in kept:
            if len(nearest) < self._near and all(abs(one.time - other.time) >= _APART_NS for other in nearest):
                nearest.append(one)
        return replace(found, nearest=tuple(nearest), profile=tuple(map(float, profile)))

    def _rows(self, reader: LogReader) -> Iterator[_Rows]:
        registry, topics = self._rule.registry(reader), self._rule.topics
        by_message = any(order_of(name) or quantity_of(place_of(name, topics).path) for name in self._rule.names)
        if self._rule.keeps or by_message:
            return self._rows_of_messages(reader, registry)
        places = {name: place_of(name, topics) for name in self._rule.names}
        selectors = {name: f"{place.topic}:{place.path}" for name, place in places.items()}
        parts = column_parts(reader, list(dict.fromkeys(selectors.values())), memory=1 << 27, registry=registry)
        last = topics[-1] if topics else None
        return _rows_of_columns(parts, places, selectors, last)

    def _rows_of_messages(self, reader: LogReader, registry: TypeRegistry) -> Iterator[_Rows]:
        """Yield moments message by message, for orders, quantities of arrays and kept values."""
        names, topics = self._rule.names, self._rule.topics
        latest = LatestFields(names, topics, registry=registry, keeps=self._rule.keeps)
        for rows in moments_of(latest, bus_messages(reader, registry), topics, registry=registry):
            known = [row for row in rows if len(row.values) == len(names)]
            unknown = sum(row.last and len(row.values) < len(names) for row in rows)
            columns = {name: column_of([row.values[name] for row in known]) for name in names}
            yield _Rows(np.array([row.time for row in known], np.int64), columns, unknown)

    def _nearest(self, kept: Sequence[NearMiss], rows: _Rows, distance: NDArray[np.float64]) -> list[NearMiss]:
        """Return the nearest of the kept moments and some new ones; of equally near ones the earliest."""
        most = _CANDIDATES * self._near
        limit = kept[-1].distance if len(kept) == most else np.inf
        chosen = np.flatnonzero(distance <= limit)
        # only the nearest of each second: all moments of a long approach would hide the next one
        seconds = rows.times[chosen] // _APART_NS
        order = np.lexsort((rows.times[chosen], distance[chosen], seconds))
        chosen = chosen[order[np.flatnonzero(np.diff(seconds[order], prepend=-1))]]
        chosen = chosen[np.argsort(distance[chosen], kind="stable")[:most]]
        more = [
            NearMiss(
                float(distance[row]),
                int(rows.times[row]),
                {self._rule.in_words(name): column[row : row + 1].tolist()[0] for name, column in rows.columns.items()},
            )
            for row in chosen.tolist()
        ]
        return sorted([*kept, *more], key=lambda one: (one.distance, one.time))[:most]


def scan_logs(
    source: Path, logs: Sequence[LogEntry], *, near: int = 3, within: float = 1.0, progress: Progress | None = None
) -> FleetScan:
    """Judge logs by a rule.

    Args:
        within: Distance below which a moment is a near miss, in nominal spreads of the rule's fields.

    Raises:
        ConfigError: There is no rule.
    """
    rule = ScanRule(source)
    scanner = Scanner(rule, near=near)
    found = []
    for number, entry in enumerate(logs):
        if not entry.readable:
            scan = LogScan(entry.place, entry.robot, problem=entry.problem)
        else:
            try:
                with copied(entry.place) as path:
                    scan = scanner.scan(path, place=entry.place, robot=entry.robot)
            except RiotError as error:  # one unavailable log is no reason to give up on all others
                scan = LogScan(entry.place, entry.robot, problem=error.message)
        found.append(scan)
        if progress is not None:
            progress(number + 1, len(logs), entry.place[-60:])
    return FleetScan(rule.text, within, tuple(sorted(found, key=lambda log: log.distance)))


@dataclass(slots=True)
class _Recent:
    """Values of a field, with those of former parts that are still needed."""

    values: NDArray[Any] = field(default_factory=lambda: np.zeros(0, bool))
    valid: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))

    def extend(self, values: NDArray[Any], valid: NDArray[np.bool_], *, keep: int) -> int:
        """Append values to the last few earlier ones; return the number of these."""
        before = min(keep, len(self.valid))
        self.values = np.concatenate([self.values[len(self.values) - before :], values]) if before else values
        self.valid = np.concatenate([self.valid[len(self.valid) - before :], valid])
        return before


def _rows_of_columns(
    parts: Iterator[Columns], places: Mapping[str, FieldPlace], selectors: Mapping[str, str], last: str | None
) -> Iterator[_Rows]:
    """Yield moments part by part: at each message of the topics, each field from the latest message of its topic.

    Args:
        places: For each name the message of its topic that it refers to.
        last: Topic whose messages are counted where a field is not known; None for all.
    """
    recent: dict[str, _Recent] = {name: _Recent() for name in places}
    topics = list(dict.fromkeys(place.topic for place in places.values()))
    for part in parts:
        whole = {
            topic: max((part[selectors[name]] for name, place in places.items() if place.topic == topic), key=len)
            for topic in topics
        }
        times = np.concatenate([whole[topic].times for topic in topics])
        order = np.concatenate([whole[topic].order for topic in topics])
        of = np.repeat(np.arange(len(topics)), [len(whole[topic]) for topic in topics])
        sorted_ = np.lexsort((order, times))
        times, of = times[sorted_], of[sorted_]
        known = np.ones(len(times), bool)
        columns = {}
        for name, place in places.items():
            values, valid = filled(part[selectors[name]], whole[place.topic])
            before = recent[name].extend(values, valid, keep=place.back + 1)
            rows = np.cumsum(of == topics.index(place.topic)) - 1 + before - place.back
            known &= (rows >= 0) & recent[name].valid[np.maximum(rows, 0)] if len(recent[name].valid) else False
            columns[name] = rows
        unknown = int(np.count_nonzero(~known & ((of == topics.index(last)) if last in topics else True)))
        yield _Rows(times[known], {name: recent[name].values[rows[known]] for name, rows in columns.items()}, unknown)


def filled(column: Column, whole: Column) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return a column's values, and whether each is valid, one for each message of its topic."""
    if len(column) == len(whole):
        return column.values, column.valid
    values, valid = np.zeros(len(whole), column.values.dtype), np.zeros(len(whole), bool)
    rows = np.searchsorted(whole.order, column.order)  # a topic of several types: some lack the field
    values[rows], valid[rows] = column.values, column.valid
    return values, valid
