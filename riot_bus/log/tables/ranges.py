"""Lists every field of a log with its type and the range of its values, in bounded memory."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.log.tables.blocks import load_ahead
from riot_bus.log.tables.plan import Feed, delivered_sources, log_registry
from riot_bus.types.bulk import as_array, gather
from riot_bus.types.capabilities import DescribesFields
from riot_bus.types.fields import MOST_FIELDS, FieldType, of_numbers
from riot_bus.vocabulary.errors import ConfigError, PayloadError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from riot_bus.log.reader import LogReader
    from riot_bus.types.model import MessageType
    from riot_bus.types.payloads import Payloads
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Scalar

_ELEMENTS = 16  # each is a path of its own, whose values are gathered from all messages
_NESTED_ELEMENTS = 4  # of each level, so that three levels have 64 paths
_MOST_NESTED = 3  # each further level would take four times as many paths
_MOST_SURVEYED = 1000  # each field takes a pass over the payloads; the rest counts as omitted
_MOST_IN_ALL = 100_000  # of all topics, which may be 60,000: a robot's 500 have 50,000 if they have 100 each
_EXAMPLES = 4  # all examples of a field share a cell of a table
_EXAMPLE_LENGTH = 40  # four examples take 160 characters; texts and bytes may have any length
_INDEX = re.compile(r"\[\d+\]")


@dataclass(slots=True)
class FieldRange:
    """One field of a topic.

    Attributes:
        path: Path, such as `pose.position.x`; `ranges[*]` for all elements of an array.
        type: Type as in `riot_bus.types.model.Leaf`; several, joined by `|`, if payloads differ.
        count: Number of values, including NaN.
        nan: Number of NaN values.
        low: Least value except NaN; None if there is none, and for text and bytes.
        high: Greatest value except NaN; None as for `low`.
        examples: The first few distinct texts, shortened.
        partial: Whether only the first elements of its arrays were looked at.
    """

    path: str
    type: str
    count: int = 0
    nan: int = 0
    low: float | None = None
    high: float | None = None
    examples: list[str] = field(default_factory=list)
    partial: bool = False

    def add(self, values: NDArray[Any]) -> None:
        """Extend the range by some values."""
        self.count += len(values)
        if not len(values):
            return
        if values.dtype.kind == "f":
            missing = np.isnan(values)
            if missing.any():
                self.nan += int(np.count_nonzero(missing))
                values = values[~missing]
                if not len(values):
                    return
        elif values.dtype == np.object_:
            self._add_objects(values)
            return
        self._widen(values.min().item(), values.max().item())

    def _add_objects(self, values: NDArray[Any]) -> None:
        for value in values.tolist():
            if isinstance(value, int | float):
                if value != value:
                    self.nan += 1
                else:
                    self._widen(value, value)
            elif len(self.examples) < _EXAMPLES:
                text = value if isinstance(value, str) else value[:_EXAMPLE_LENGTH].hex()
                text = text if len(text) <= _EXAMPLE_LENGTH else text[: _EXAMPLE_LENGTH - 3] + "..."
                if text not in self.examples:
                    self.examples.append(text)

    def _widen(self, low: float, high: float) -> None:
        self.low = low if self.low is None or low < self.low else self.low
        self.high = high if self.high is None or high > self.high else self.high


@dataclass(slots=True)
class TopicFields:
    """The fields of a topic.

    Attributes:
        type: Name of the type; empty if it is not known.
        unreadable: Number of messages that cannot be decoded.
        omitted: Number of fields that were left out, as too many or too deeply nested.
    """

    topic: str
    key: str
    type: str
    count: int = 0
    unreadable: int = 0
    fields: list[FieldRange] = field(default_factory=list)
    omitted: int = 0


def field_ranges(
    reader: LogReader,
    *,
    topics: Sequence[str] | None = None,
    registry: TypeRegistry | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[TopicFields]:
    """Read a log from end to end and return the fields of its delivered messages.

    Args:
        reader: The log.
        topics: Topic names or key expressions; None for all.
        registry: Types that the log does not define.
        progress: Function called after each block with the bytes read so far and the size of the file.

    Raises:
        ConfigError: The log has no such topic, or its topics have too many fields.
    """
    registry = log_registry(reader) if registry is None else registry
    sources = delivered_sources(reader, registry, topics)
    feeds = {number: Feed(number, source) for number, source in sources.items()}
    found: dict[str, TopicFields] = {}
    surveys: dict[tuple[str, int], _Survey] = {}
    read = surveyed = 0
    for block in load_ahead(reader, reader.blocks(), memory=reader.limits.held, threads=1, largest=reader.limits.chunk):
        for number, rows in block.by_channel():
            feed = feeds.get(number)
            if feed is None:
                continue
            source = feed.source
            topic = found.setdefault(source.key, TopicFields(source.topic, source.key, source.schema.name))
            topic.count += len(rows)
            payloads = block.payloads(rows)
            kind = feed.settle(payloads, registry)
            if kind is not None:
                topic.type = kind.name
                place = source.key, id(kind)
                if place not in surveys:
                    surveys[place] = _Survey(kind)
                    surveyed += len(surveys[place].ranges)
                    if surveyed > _MOST_IN_ALL:
                        text = f"the topics of this log have more than {_MOST_IN_ALL} fields"
                        raise ConfigError(text, where=reader.path, hint="name those that you want: --topics TOPIC")
                topic.unreadable += surveys[place].add(payloads)
        read += block.block.body.length
        if progress is not None:
            progress(read, reader.size)
    for (key, _), survey in surveys.items():
        found[key].fields += survey.ranges.values()
        found[key].omitted += survey.omitted
    return sorted(found.values(), key=lambda each: (each.topic, each.key))


class _Survey:
    """The fields of messages of one type."""

    def __init__(self, kind: MessageType) -> None:
        self.ranges: dict[str, FieldRange] = {}
        self.omitted = 0
        self._kind = kind
        self._described: DescribesFields | None = None
        self._fields: list[FieldType] = []
        if isinstance(kind, DescribesFields):
            try:
                listed = kind.fields()
                self._fields = [each for each in listed if each.path.count("[*]") <= _MOST_NESTED][:_MOST_SURVEYED]
                self.omitted = len(listed) - len(self._fields)
                self._described = kind
            except PayloadError:
                return
        for each in self._fields:
            partial = "[*]" in each.path and not of_numbers(each)
            self.ranges[each.path] = FieldRange(each.path, each.type, partial=partial)

    def add(self, payloads: Payloads) -> int:
        """Survey some messages, and return how many cannot be decoded."""
        if self._described is None:
            return self._one_by_one(payloads)
        whole = np.ones(len(payloads), np.bool_)
        for each in self._fields:
            known = self.ranges[each.path]
            if of_numbers(each):
                for values in self._described.elements(payloads, each.path.removesuffix("[*]")):
                    known.add(values)
            elif "[*]" in each.path:
                for path in _places(each.path):
                    some = gather(self._kind, payloads, path)
                    known.add(some.values[some.valid])
                    if not some.valid.any():
                        break
            else:
                some = gather(self._kind, payloads, each.path)
                known.add(some.values[some.valid])
                whole &= some.valid
        return int(np.count_nonzero(~whole))

    def _one_by_one(self, payloads: Payloads) -> int:
        unreadable = 0
        values: dict[str, list[Scalar | None]] = {}
        for payload in payloads:
            try:
                leaves = self._kind.leaves(payload, elements=_ELEMENTS)
            except PayloadError:
                unreadable += 1
                continue
            for leaf in leaves:
                path = _INDEX.sub("[*]", leaf.path) if "[" in leaf.path else leaf.path
                known = self.ranges.get(path)
                if known is None:
                    if len(self.ranges) >= MOST_FIELDS:
                        continue
                    known = self.ranges[path] = FieldRange(path, leaf.type, partial="[*]" in path)
                elif leaf.type not in known.type.split("|"):
                    known.type += f"|{leaf.type}"
                values.setdefault(path, []).append(leaf.value)
        for path, some in values.items():
            self.ranges[path].add(as_array(some).values)
        return unreadable


def _places(path: str) -> list[str]:
    """Return the paths of the first elements."""
    many = _ELEMENTS if path.count("[*]") == 1 else _NESTED_ELEMENTS
    found = [path]
    while "[*]" in found[0]:
        found = [each.replace("[*]", f"[{index}]", 1) for each in found for index in range(many)]
    return found
