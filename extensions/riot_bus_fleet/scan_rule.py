"""A finding's rule with all that is needed to judge the messages of other logs by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riot_bus.chain.base.systems import described
from riot_bus.chain.unit.prediction import alike, rule_text
from riot_bus.findings.records import FindingRecord, MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.log.foreign import learn_types
from riot_bus.log.reader import LogReader
from riot_bus.log.tables.plan import log_registry
from riot_bus.types.latest import in_words, place_of
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.order import order_of


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
