"""The numbers of whole logs as arrays, in bounded memory, for observational evidence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riot_bus.log.info import log_info
from riot_bus.log.reader import LogReader
from riot_bus.log.tables.plan import topic_types
from riot_bus.log.tables.table import Column, Columns, column_parts
from riot_bus.types.brittle import is_brittle
from riot_bus.types.fields import FieldType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.trial import Progress
from riot_bus_fleet.evidence.alignment import Piece
from riot_bus_fleet.scan import filled

_MEMORY = 1 << 29
"""Bytes that the numbers may take: of larger logs, only stretches are read."""

_STRETCHES = 10
_ELEMENTS = 4
"""Number of elements of each array that are fields of their own, as in `chain.base.logs`."""

_MOST_FIELDS = 200  # 808 bytes for a message, of which `_MEMORY` holds 660,000
_TEXTS = frozenset({"string", "bytes"})


@dataclass(slots=True)
class LogColumns:
    """Numbers that were read from logs."""

    pieces: list[Piece] = field(default_factory=list)
    topics: dict[str, int] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)
    messages: int = 0
    looked_at: int = 0
    notes: list[str] = field(default_factory=list)


def read_pieces(
    logs: Sequence[Path],
    registry_of: Callable[[LogReader], TypeRegistry],
    *,
    wanted: Sequence[str] = (),
    memory: int = _MEMORY,
    progress: Progress | None = None,
) -> LogColumns:
    """Read all numeric fields of logs; texts, stamps, sequence numbers and the like are left out.

    Args:
        memory: Bytes that the numbers may take; if there are more, ten evenly spaced stretches of each log are read.

    Raises:
        ConfigError: A file is not a log.
    """
    found = LogColumns()
    plans: list[tuple[Path, dict[str, list[str]], tuple[int, int]]] = []
    size = 0
    for path in logs:
        info = log_info(path)
        with LogReader(path) as reader:
            registry: TypeRegistry = registry_of(reader)
            fields = _fields(topic_types(reader, registry), wanted, found.notes)
        for topic in info.topics:
            found.topics[topic.topic] = found.topics.get(topic.topic, 0) + topic.count
            found.keys.setdefault(topic.topic, topic.key)
            size += topic.count * (8 + 4 * len(fields.get(topic.topic, ())))
        found.messages += info.count
        if info.loss:
            found.notes.append(f"{path}: {info.loss}")
        plans.append((path, fields, (info.start or 0, (info.end or 0) + 1)))
    share = min(1.0, memory / size) if size else 1.0
    for number, (path, fields, span) in enumerate(plans):
        with LogReader(path) as reader:
            registry = registry_of(reader)
            names = [one for some in fields.values() for one in some]
            for start, end in _stretches(span, share):
                parts: Iterable[Columns] = ()
                if names:
                    parts = column_parts(reader, names, start=start, end=end, memory=1 << 27, registry=registry)
                piece = _collect(parts, fields, log=number)
                found.looked_at += sum(map(len, piece.times.values()))
                found.pieces.append(piece)
        if progress is not None:
            progress(number + 1, len(plans), f"read {path}")
    found.notes = list(dict.fromkeys(found.notes))
    if share < 1.0:
        found.notes.append(
            f"{share:.0%} of the time was looked at, in {_STRETCHES} stretches of each log: the numbers of all of it "
            f"take {size >> 20} MiB, of at most {memory >> 20}"
        )
    return found


def _stretches(span: tuple[int, int], share: float) -> list[tuple[int, int]]:
    if share >= 1.0:
        return [span]
    start, end = span
    length = (end - start) / _STRETCHES
    return [(round(start + place * length), round(start + (place + share) * length)) for place in range(_STRETCHES)]


def _fields(types: Sequence[tuple[str, Any]], wanted: Sequence[str], notes: list[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for topic, listing in types:
        names = [f"{topic}:{path}" for each in listing.fields for path in _paths(each)]
        asked = [name for name in wanted if name.startswith(f"{topic}:") and name not in names]
        if listing.problem or not listing.name:
            notes.append(f"{topic}: its fields are not known ({listing.problem or 'no type'})")
        if len(names) > _MOST_FIELDS:
            notes.append(f"{topic}: {len(names) - _MOST_FIELDS} of {len(names)} fields were not looked at")
        found[topic] = list(dict.fromkeys([*found.get(topic, []), *names[:_MOST_FIELDS], *asked]))
    return found


def _paths(each: FieldType) -> list[str]:
    if each.type.split("|")[0] in _TEXTS or is_brittle(each.path):
        return []
    paths = [each.path]
    while "[*]" in paths[0]:
        many = min(each.length or _ELEMENTS, _ELEMENTS) if paths[0].count("[*]") == 1 else _ELEMENTS
        paths = [path.replace("[*]", f"[{index}]", 1) for path in paths for index in range(many)]
    return paths


class _Growing:
    """Values of one field; a single number as long as they are all equal."""

    def __init__(self) -> None:
        self.base: float | None = None
        self._alike = 0
        self._parts: list[NDArray[np.float32]] = []

    def extend(self, values: NDArray[np.float64]) -> None:
        if self.base is None:
            finite = values[np.isfinite(values)]
            self.base = float(finite[0]) if len(finite) else None
        if self.base is None:
            self._parts.append(np.full(len(values), np.nan, np.float32))
            return
        # Relative to the first value, since float32 has too few digits for a place on Earth.
        with np.errstate(over="ignore", invalid="ignore"):
            moved = (values - self.base).astype(np.float32)
        if not self._parts and not moved.any():
            self._alike += len(moved)
            return
        if not self._parts and self._alike:
            self._parts.append(np.zeros(self._alike, np.float32))
        self._parts.append(moved)

    def values(self) -> NDArray[np.float32] | None:
        """Return the values relative to `base`; None if they are all equal or not finite."""
        return np.concatenate(self._parts) if self._parts and self.base is not None else None


def _collect(parts: Iterable[Columns], fields: Mapping[str, Sequence[str]], *, log: int) -> Piece:
    times: dict[str, list[NDArray[np.int64]]] = {topic: [] for topic in fields}
    growing = {name: _Growing() for some in fields.values() for name in some}
    for part in parts:
        for topic, names in fields.items():
            if not names:
                continue
            whole = max((part[name] for name in names), key=len)
            if not len(whole):
                continue
            times[topic].append(whole.times)
            for name in names:
                growing[name].extend(_numbers(part[name], whole))
    seconds = {topic: np.concatenate(some) / 1e9 for topic, some in times.items() if some}
    values: dict[str, NDArray[Any]] = {}
    for topic, names in fields.items():
        for name in names:
            grown = growing.pop(name)
            if topic in seconds and grown.base is not None:
                found = grown.values()
                # A field that never changed needs no memory: one number is broadcast over all messages.
                values[name] = np.broadcast_to(np.float32(0.0), len(seconds[topic])) if found is None else found
    return Piece(seconds, values, log)


def _numbers(column: Column, whole: Column) -> NDArray[np.float64]:
    """Return a column's numbers, one for each message of its topic, NaN where it has none."""
    values, valid = filled(column, whole)
    if values.dtype == np.object_:
        numbers = (float(one) if isinstance(one, int | float) else np.nan for one in values.tolist())
        values = np.fromiter(numbers, np.float64, len(values))
    return np.where(valid, values.astype(np.float64), np.nan)
