"""The interceptor that stands in front of a unit and does not let through what a rule says it fails on."""

from __future__ import annotations

import json
import logging
import math
import operator
import re
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from riot_bus.generalize.arrays import with_column
from riot_bus.generalize.forms.function import judge_of
from riot_bus.generalize.forms.repair import Repair, why_not_repairable
from riot_bus.generalize.rule import Rule
from riot_bus.given_files import given_bytes
from riot_bus.types.latest import place_of
from riot_bus.vocabulary.elements import Elements, quantity_of
from riot_bus.vocabulary.errors import ConfigError, PayloadError, located
from riot_bus.vocabulary.order import order_of
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.pipeline.event import Event
    from riot_bus.vocabulary.order import Order

_LOG = logging.getLogger(__name__)
_WILD = re.compile(r"[*$?#]")
_NUMBERED = re.compile(r"(.+)\[(\d{1,6})\]:[^:]*", re.DOTALL)
_BEYOND: Mapping[str, Callable[[Any, Any], bool]] = {
    "max": operator.gt,
    "min": operator.lt,
    "isnan": lambda element, _: math.isnan(element),
    "nonfinite": lambda element, _: not math.isfinite(element),
}
"""By quantity of elements: whether an element violates a wanted value of the quantity."""
_MOST_BACK = 64
"""Most earlier messages of a topic that are remembered; the logs that rules are learnt from are short."""


class _Field(NamedTuple):
    place: int
    path: str
    back: int = 0


@dataclass
class RuleGuard:
    """Keep from a unit what a rule says it fails on; all other messages pass as they are.

    If the rule relates fields of several topics or of earlier messages, a message is judged with the values delivered
    for these; conditions on a value that has not arrived yet do not hold. An order of messages is judged at the second
    one. A message that lacks a field of the rule passes, and counts as an error of this interceptor.

    Args:
        rule: A finding's rule.json.
        action: Treatment of a message for which the rule holds: drop it; clamp its fields to the nearest values
            for which the rule does not hold; hold its fields at those of the last good message; or report it and let
            it pass. Where clamp or hold cannot help, it is dropped. Of an array whose elements the rule is about, those
            alone are changed that are too large, too small or no numbers.
    """

    name: ClassVar[str] = "guard"
    rule: Path
    action: Literal["drop", "clamp", "hold", "report"] = "drop"

    def __post_init__(self) -> None:
        record = _read(self.rule)
        embedded = record.get("rule", record)
        self._rule = Rule.from_json(embedded if isinstance(embedded, Mapping) else {})
        self._names = self._rule.variables
        self._orders: dict[str, list[tuple[int, Order]]] = {}
        self._fields = self._by_topic(_topics(record.get("topics"), self._names))
        self.topics = list(self._fields)
        earlier = {topic: [one for one in fields if one.back] for topic, fields in self._fields.items()}
        self._kept = {topic: {one.path for one in fields} for topic, fields in earlier.items() if fields}
        self._past: dict[str, deque[dict[str, Any]]] = {
            topic: deque(maxlen=max(one.back for one in earlier[topic])) for topic in self._kept
        }
        self._came: set[str] = set()
        self.met: Counter[str] = Counter()
        """Messages for which the rule held, by topic."""
        self.done: Counter[str] = Counter()
        """What was done with them: dropped, clamped, held, reported."""
        self._judge = judge_of(self._rule.terms, self._names)
        self._delivered: list[Any] = [None] * len(self._names)
        self._good: set[str] = set()
        self._good_elements: dict[tuple[str, str], Elements] = {}
        self._repairs = self._clamps(record) if self.action == "clamp" else {}

    def _by_topic(self, topics: Sequence[str]) -> dict[str, list[_Field]]:
        found: dict[str, list[_Field]] = {}
        for place, variable in enumerate(self._names):
            order = order_of(variable)
            if order is not None:
                self._orders.setdefault(order.second, []).append((place, order))
            with located(str(self.rule)):
                parts = None if order else place_of(variable, topics)
            for topic in (parts.topic,) if parts else order[:2] if order else ():
                if _WILD.search(topic) or not _selects(topic) or (parts and not parts.path):
                    raise ConfigError(f"{variable!r} is not a field of a topic", where=str(self.rule))
                found.setdefault(topic, [])
            if parts and parts.back > _MOST_BACK:
                raise ConfigError(
                    f"{variable!r} is of a message too long ago", where=str(self.rule), hint=f"at most {_MOST_BACK}"
                )
            if parts:
                found[parts.topic].append(_Field(place, parts.path, parts.back))
        if not found:
            hint = "it is never or always met, so there is nothing to tell messages apart by"
            raise ConfigError("the rule has no fields", where=str(self.rule), hint=hint)
        return found

    def _clamps(self, record: Mapping[str, Any]) -> dict[str, Repair]:
        types, scale = _texts(record.get("types")), _numbers(record.get("scale"))
        if missing := sorted(set(self._names) - set(types)):
            hint = "`riot rules` of this version writes them; drop and hold do not need them"
            raise ConfigError(f"clamp has to know the type of {missing[0]!r}", where=str(self.rule), hint=hint)
        repairs = {}
        for topic, fields in self._fields.items():
            # the length of an array is not a value of the message: changing it would invent elements
            movable = [self._names[one.place] for one in fields if not one.back and not one.path.startswith("len(")]
            if why := self._why_not(movable, types):
                hint = "use drop or hold"
                raise ConfigError(f"clamp is not defined for {topic}: {why}", where=str(self.rule), hint=hint)
            repairs[topic] = Repair(self._rule.terms, self._names, movable=movable, types=types, scale=scale)
        return repairs

    def _why_not(self, movable: Sequence[str], types: Mapping[str, str]) -> str:
        own = set(movable)
        # a message only changes the truth of terms that have one of its fields
        terms = (
            tuple(term for term in self._rule.terms if any(own & set(literal.feature.args) for literal in term))
            if len(self._fields) > 1
            else self._rule.terms
        )
        return why_not_repairable(terms, movable, types)

    def message(self, event: Event) -> None:
        """Judge a message, and act on it only if the rule holds."""
        fields = self._fields.get(event.topic)
        if fields is None:
            return
        try:
            values = self._read(event, fields)
        except PayloadError:
            self._remember(event)  # it passes
            raise
        if values is None:
            return
        if self._judge(values):
            values = self._act(event, fields, values)
        if values is not None:
            self._delivered = values
            self._good.add(event.topic)
            if self.action == "hold":
                self._keep_elements(event, fields)
        if not event.dropped:
            self._remember(event)

    def _read(self, event: Event, fields: Sequence[_Field]) -> list[Any] | None:
        values = self._delivered.copy()
        try:
            for place, path, back in fields:
                values[place] = self._before(event.topic, path, back) if back else event.read(path)
        except PayloadError:
            if event.original.kind == "delete":
                return None
            raise
        for second, orders in self._orders.items():
            for place, order in orders:
                held = order.first in self._came and not (order.once and second in self._came)
                values[place] = held if event.topic == second else None
        return values

    def _before(self, topic: str, path: str, back: int) -> Any:
        past = self._past[topic]
        return past[-back].get(path) if len(past) >= back else None

    def _remember(self, event: Event) -> None:
        """Keep the values of a delivered message that later ones are judged with."""
        if self._orders:
            self._came.add(event.topic)
        if event.topic in self._past:
            kept: dict[str, Any] = {}
            for path in self._kept[event.topic]:
                with suppress(PayloadError):
                    kept[path] = event.read(path)
            self._past[event.topic].append(kept)

    def _act(self, event: Event, fields: Sequence[_Field], values: list[Any]) -> list[Any] | None:
        """Act on a message that meets the rule; return the values that are delivered and good, or None."""
        self.met[event.topic] += 1
        if self.action == "report":
            self._delivered = values
            self._tell(event, values, "reported")
            return None
        wanted = self._wanted(event.topic, values)
        if wanted is not None:
            try:
                for place, path, back in fields:
                    if not back and wanted[place] is not values[place]:
                        self._set(event, path, wanted[place])
                now = self._read(event, fields)
            except PayloadError:
                now = None
            if now is not None and not self._judge(now):
                self._tell(event, values, "clamped" if self.action == "clamp" else "held")
                return now
        event.drop()
        self._tell(event, values, "dropped")
        return None

    def _keep_elements(self, event: Event, fields: Sequence[_Field]) -> None:
        for _, path, back in fields:
            if not back and (quantity := quantity_of(path)):
                self._good_elements[event.topic, quantity.path] = event.read_elements(quantity.path)

    def _set(self, event: Event, path: str, wanted: Any) -> None:
        """Set a field; for a quantity of elements, set those that violate it (hold: to their last good values)."""
        quantity = quantity_of(path)
        if quantity is None:
            event.set(path, wanted)
            return
        now = event.read_elements(quantity.path)
        if self.action == "clamp":
            event.set_elements(quantity.path, with_column(now, path, None, wanted))
            return
        good = self._good_elements[event.topic, quantity.path]
        if len(good) != len(now):
            raise PayloadError("the last good array has another length", where=quantity.path)
        beyond = _BEYOND[quantity.kind]
        held = [old if beyond(new, wanted) else new for old, new in zip(good, now, strict=True)]
        event.set_elements(quantity.path, Elements(held))

    def _wanted(self, topic: str, values: list[Any]) -> list[Any] | None:
        if self.action == "clamp":
            return self._repairs[topic](values)
        return self._delivered if self.action == "hold" and topic in self._good else None

    def _tell(self, event: Event, values: list[Any], what: str) -> None:
        self.done[what] += 1
        count = self.met.total()
        if count & (count - 1) == 0:  # the first, and then ever more rarely
            told = ", ".join(f"{name} = {str(value)[:40]}" for name, value in zip(self._names, values, strict=True))
            _LOG.warning("guard: message %d of %s %s (%s); so far %d", event.index, event.topic, what, told, count)

    def stop(self) -> None:
        """Log what was done."""
        if self.met:
            done = ", ".join(f"{count} {what}" for what, count in self.done.items())
            _LOG.warning("guard: %s: the rule held for %d messages: %s", self.rule, self.met.total(), done)


def _topics(given: Any, names: Sequence[str]) -> list[str]:
    """Return the topics of the log that the names refer to: the recorded ones, or as many as the names need."""
    if isinstance(given, list) and given and all(isinstance(topic, str) for topic in given):
        return given
    numbered = [found.groups() for name in names if (found := _NUMBERED.fullmatch(name))]
    most = {topic: max(int(number) for each, number in numbered if each == topic) for topic, _ in numbered}
    return [topic for topic, number in most.items() for _ in range(min(number, _MOST_BACK) + 1)]


def _selects(topic: str) -> bool:
    try:
        parsed = parse_selector(topic)
    except ConfigError:
        return False
    return parsed.topic == topic and parsed.field is None and parsed.where is None


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(given_bytes(path, most=1 << 24))  # it has a few hundred samples
    except OSError as error:
        raise ConfigError(f"cannot read the rule: {error.strerror}", where=str(path)) from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"the rule is not JSON: {error}", where=str(path)) from error
    if not isinstance(record, dict):
        raise ConfigError("this is not a rule", where=str(path), hint="name the rule.json of a finding")
    return record


def _texts(given: Any) -> dict[str, str]:
    return {k: v for k, v in given.items() if isinstance(v, str)} if isinstance(given, dict) else {}


def _numbers(given: Any) -> dict[str, float]:
    if not isinstance(given, dict):
        return {}
    return {k: float(v) for k, v in given.items() if isinstance(v, int | float) and 0 < v < math.inf}
