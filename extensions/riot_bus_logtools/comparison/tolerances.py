"""Tolerances, within which values count as the same: `TOPIC:PATH=0.01`, `=1%`, `=ignore`; `TOPIC=5` messages.

A topic is a name or a key expression; in a path `*` stands for any text, and `[*]` for any element. The last match
counts. A file is TOML: one table `[tolerances]` with the same left sides as keys.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

from riot_bus.given_files import MOST_TOML, given_text
from riot_bus.types.brittle import STAMPS, is_brittle, why_brittle
from riot_bus.types.model import MessageType
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.field_pattern import names_field
from riot_bus.vocabulary.selector import split_field
from riot_bus.vocabulary.toml_text import parse_toml

TABLE = "tolerances"
_PERCENT = re.compile(r"(.+)%")
_HINT = "write TOPIC:PATH=0.01, TOPIC:PATH=1%, TOPIC:PATH=ignore, or TOPIC=5 if counts may differ by 5"


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far two values may be apart.

    Attributes:
        absolute: Allowed difference, in the unit of the field.
        relative: Allowed difference, as a share of the larger value.
        leave: Reason why they are not compared at all; empty if they are.
    """

    absolute: float = 0.0
    relative: float = 0.0
    leave: Literal["", "ignored", "a time"] = ""

    def allows(self, a: float, b: float) -> bool:
        """Return whether two numbers are close enough; NaN is only close to NaN, an infinity only to itself."""
        return a == b or abs(a - b) <= self.of(a, b) or (a != a and b != b)

    def of(self, a: float, b: float) -> float:
        """Return the allowed difference of two numbers; 0 if one of them is infinite."""
        most = max(abs(a), abs(b))
        return max(self.absolute, self.relative * most) if most < math.inf else 0.0


EXACT: Final = Tolerance()
IGNORED: Final = Tolerance(leave="ignored")
TIME: Final = Tolerance(leave="a time")
"""Tolerance of fields that are times: when the system responds is compared separately from what it responds."""


@dataclass(frozen=True, slots=True)
class ToleranceEntry:
    """What is tolerated of the fields that a text names."""

    text: str
    topic: str
    path: str
    tolerance: Tolerance


class TolerancesOfTopic:
    """Tolerances of the fields of one topic, in order of precedence, and of its number of messages."""

    def __init__(self, entries: Sequence[ToleranceEntry] = ()) -> None:
        self._entries = entries

    @cached_property
    def messages(self) -> Tolerance:
        """How many messages may be lost, added or out of order; `leave` where the topic is not compared."""
        return next((each.tolerance for each in self._entries if not each.path), EXACT)

    def of_field(self, path: str, kind: MessageType | None = None) -> Tolerance:
        """Return the tolerance of a field: the one given, or else `TIME` for times and `EXACT` for other fields."""
        for each in self._entries:
            if each.path and names_field(each.path, path):
                return each.tolerance
        all_time = kind is not None and is_brittle(path, kind.name) == "timestamp"  # such as rosgraph_msgs/msg/Clock
        return TIME if all_time or why_brittle(path, kind) in STAMPS else EXACT


class TopicTolerances:
    """Tolerances of the topics of two logs; the last one that names a field counts."""

    def __init__(self, entries: Sequence[ToleranceEntry] = ()) -> None:
        self._entries = entries

    def of_topic(self, named: Callable[[str], bool]) -> TolerancesOfTopic:
        """Return the tolerances of a topic; `named` tells whether a name or key expression includes it."""
        return TolerancesOfTopic([each for each in reversed(self._entries) if named(each.topic)])

    def unused(self, named: Callable[[str], bool]) -> list[str]:
        """Return the entries that name no topic; `named` tells whether a name or key expression includes any."""
        return [each.text for each in self._entries if not named(each.topic)]


def tolerances_of(texts: Sequence[str], files: Sequence[Path] = ()) -> TopicTolerances:
    """Return the tolerances of files and of options, which take precedence; raises ConfigError."""
    found = [entry_of(text, value, str(file)) for file in files for text, value in _table_of(file).items()]
    for text in texts:
        left, equals, value = text.rpartition("=")
        if not equals:
            raise ConfigError(f"{text!r} says no tolerance", where="--tolerance", hint=_HINT)
        found.append(entry_of(left.strip(), value.strip(), "--tolerance"))
    return TopicTolerances(found)


def _table_of(path: Path) -> Mapping[str, object]:
    """Return the table of a file; raises ConfigError if it cannot be read, or contains something else."""
    try:
        document = parse_toml(given_text(path, most=MOST_TOML), where=str(path))
    except OSError as error:
        raise ConfigError(f"cannot read the tolerances: {error.strerror}", where=str(path)) from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"not a TOML file: {error}", where=str(path)) from None
    table = document.get(TABLE)
    if set(document) != {TABLE} or not isinstance(table, Mapping):
        hint = f"write one table [{TABLE}] with lines such as '\"/odom:pose.pose.position.x\" = 0.01'"
        raise ConfigError("this file holds something else than tolerances", where=str(path), hint=hint)
    return table


def entry_of(text: str, value: object, where: str = TABLE) -> ToleranceEntry:
    """Return an entry from its left side and value, a number, `1%` or `ignore`; raises ConfigError for others."""
    topic, path = split_field(text)
    tolerance = _tolerance(value)
    if not topic or tolerance is None or text.endswith(":"):
        raise ConfigError(f"{text!r} = {value!r} says no tolerance", where=where, hint=_HINT)
    return ToleranceEntry(text, topic, path, tolerance)


def _tolerance(value: object) -> Tolerance | None:
    if value == "ignore":
        return IGNORED
    text = value if isinstance(value, str) else ""
    percent = _PERCENT.fullmatch(text)
    try:
        number = float(percent[1] if percent else text or value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    if isinstance(value, bool) or not 0.0 <= number < math.inf:
        return None
    return Tolerance(relative=number / 100) if percent else Tolerance(absolute=number)
