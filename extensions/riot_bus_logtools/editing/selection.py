"""Parses selections of messages: `TOPIC [during A..B] [index I..J] [every N] [where PREDICATE]`.

`A..B` are times as `riot_bus.log.naming.parse_time` takes them, `I..J` numbers of a topic's messages from 0 on; either
end may be left out, and the last one is not included. `every 5` means the numbers 0, 5, 10 ...
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from riot_bus.log.engine.blocks import TIMES
from riot_bus.log.naming import parse_time
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.predicate import Predicate, parse_predicate
from riot_bus.vocabulary.selector import parse_selector

_CLAUSE = re.compile(r"(.*?)\s*(?<!\S)(during|index|every)\s+(\S+)", re.DOTALL)
_HINT = "write TOPIC [during A..B] [index I..J] [every N] [where PREDICATE], such as '/odom during 5..9 where x > 3'"


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition on messages; all parts of it must be met.

    Attributes:
        low: Earliest time, nanoseconds; `high` is exclusive.
        first: First number within the topic; `last` is exclusive, None for no limit.
        every: Divisor of the selected numbers.
    """

    low: int = -TIMES
    high: int = TIMES
    first: int = 0
    last: int | None = None
    every: int = 1
    where: Predicate | None = None

    @property
    def always(self) -> bool:
        """Whether it holds for all messages."""
        return self == _ALWAYS

    def holds(self, time: int, number: int, read: Callable[[str], Scalar] | None = None) -> bool:
        """Return whether a message, by its time in nanoseconds and its number within its topic, is selected.

        The values of fields are only asked for if there is a predicate. Raises PayloadError if they cannot be compared.
        """
        if not self.low <= time < self.high or number % self.every:
            return False
        if number < self.first or (self.last is not None and number >= self.last):
            return False
        return self.where is None or read is None or self.where(read)


_ALWAYS = Condition()


@dataclass(frozen=True, slots=True)
class Selection:
    """A selection of messages of a topic.

    Attributes:
        during: Texts of two times, empty for an open end; None for all the time.
        at_any_time: Condition apart from the time.
        option: Option in which it was written, for errors.
    """

    text: str
    topic: str
    during: tuple[str, str] | None = None
    at_any_time: Condition = _ALWAYS
    option: str = ""

    @property
    def whole(self) -> bool:
        """Whether all messages of the topic are selected."""
        return self.during is None and self.follows_time

    @property
    def follows_time(self) -> bool:
        """Whether it depends only on topic and time."""
        return self.at_any_time.always

    def condition(self, origin: Callable[[], int]) -> Condition:
        """Return the condition with times in nanoseconds, from the origin on; raises ConfigError for a wrong one."""
        low, high = -TIMES, TIMES
        if self.during is not None:
            begin, end = self.during
            low = parse_time(begin, origin(), where=self.option) if begin else low
            high = parse_time(end, origin(), where=self.option) if end else high
            if high <= low:
                raise ConfigError(f"{end} is not after {begin}", where=f"{self.option} {self.text!r}")
        return replace(self.at_any_time, low=low, high=high)


def parse_selection(text: str, option: str) -> Selection:
    """Parse a selection; raises ConfigError if the text is none."""
    head, _, where = text.partition(" where ")
    match = _CLAUSE.match(head)
    name = (match[1] if match else head).strip()
    if not name:
        raise ConfigError(f"{text!r} names no topic", where=option, hint=_HINT)
    try:
        selector = parse_selector(name)
    except ConfigError as error:
        raise ConfigError(error.message, where=option, hint=_HINT) from None
    if selector.field is not None:
        hint = f"write '{selector.topic} where {selector.field} > 0', say, or only {selector.topic!r}"
        raise ConfigError(f"{name!r} names a field, not messages", where=option, hint=hint)
    rest = head[len(match[1]) :] if match else ""
    return parse_clauses(selector.topic, rest + (f" where {where}" if where else ""), text, option)


def parse_clauses(topic: str, clauses: str, text: str, option: str) -> Selection:
    """Parse the clauses after a topic; raises ConfigError if they are none."""
    head, has_predicate, predicate = f" {clauses}".partition(" where ")
    found: dict[str, str] = {}
    position = 0
    while head[position:].strip():
        match = _CLAUSE.match(head, position)
        if match is None or match[1].strip() or match[2] in found:
            raise ConfigError(f"cannot read {head[position:].strip()!r} in {text!r}", where=option, hint=_HINT)
        found[match[2]] = match[3]
        position = match.end()
    first, last = _numbers(found.get("index"), text, option)
    every = found.get("every", "1")
    if not every.isdecimal() or not 0 < int(every) < 1 << 32:
        raise ConfigError(f"every {every} in {text!r} is not a number above 0", where=option)
    during: tuple[str, str] | None = None
    if "during" in found:
        begin, dots, end = found["during"].partition("..")
        if not dots or not (begin or end):
            raise ConfigError(f"{found['during']!r} in {text!r} is not a span of time", where=option, hint="write 5..9")
        during = begin, end
    where: Predicate | None = None
    if has_predicate:
        try:
            where = parse_predicate(predicate.strip())
        except ConfigError as error:
            raise ConfigError(error.message, where=f"{option}, {error.where}", hint=error.hint) from None
    condition = Condition(first=first, last=last, every=int(every), where=where)
    return Selection(text, topic, during, condition, option)


def _numbers(text: str | None, whole: str, option: str) -> tuple[int, int | None]:
    if text is None:
        return 0, None
    begin, dots, end = text.partition("..")
    if not all(part.isdecimal() and len(part) < 16 for part in (begin, end) if part) or not (begin or end):
        hint = "write index 10..20, index 10.., index ..20 or index 7"
        raise ConfigError(f"{text!r} in {whole!r} are not numbers of messages", where=option, hint=hint)
    first = int(begin) if begin else 0
    if not dots:
        return first, first + 1
    last = int(end) if end else None
    if last is not None and last <= first:
        raise ConfigError(f"{text!r} in {whole!r} holds no number", where=option, hint="the last one is not included")
    return first, last
