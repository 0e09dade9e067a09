"""How far values may be apart, and still count as the same: `TOPIC:PATH=0.01`, `=1%`, `=ignore`; `TOPIC=5` messages.

A topic is a name or a key expression; in a path `*` stands for any text, and `[*]` for any element. What stands last
counts. A file is TOML: one table `[tolerances]` with the same left sides as keys.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal

from riot_bus.types.brittle import STAMPS, is_brittle, why_brittle
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.field_pattern import names_field
from riot_bus.vocabulary.selector import split_field

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from riot_bus.types.model import MessageType

__all__ = [
    "EXACT",
    "IGNORED",
    "TIME",
    "Tolerance",
    "TolerancesOfTopic",
    "TopicTolerances",
    "read_tolerances",
    "tolerances_of",
]

TABLE = "tolerances"
_PERCENT = re.compile(r"(.+)%")
_HINT = "write TOPIC:PATH=0.01, TOPIC:PATH=1%, TOPIC:PATH=ignore, or TOPIC=5 if counts may differ by 5"


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far two values may be apart.

    Attributes:
        absolute: Allowed difference, in the unit of the field.
        relative: Or by so much of the larger one.
        leave: Why they are not compared at all; empty if they are.
    """

    absolute: float = 0.0
    relative: float = 0.0
    leave: Literal["", "ignored", "a time"] = ""

    def allows(self, a: float, b: float) -> bool:
        """Return whether two numbers are near enough; NaN is near NaN alone, an infinity near itself alone."""
        return a == b or abs(a - b) <= self.of(a, b) or (a != a and b != b)

    def of(self, a: float, b: float) -> float:
        """Return by how much these two may be apart; nothing where one of them is infinite."""
        most = max(abs(a), abs(b))
        return max(self.absolute, self.relative * most) if most < math.inf else 0.0


EXACT: Final = Tolerance()
IGNORED: Final = Tolerance(leave="ignored")
TIME: Final = Tolerance(leave="a time")
"""Of fields that are times: when something is answered is told apart from what is answered."""


@dataclass(frozen=True, slots=True)
class _Entry:
    text: str
    topic: str
    path: str
    tolerance: Tolerance


class TolerancesOfTopic:
    """What holds for the fields of one topic, and for its number of messages.

    Args:
        entries: Of this topic, those that count most first.
    """

    def __init__(self, entries: Sequence[_Entry] = ()) -> None:
        self._entries = entries

    @cached_property
    def messages(self) -> Tolerance:
        """How many messages may be lost, added or out of order; `leave` where the topic is not compared."""
        return next((each.tolerance for each in self._entries if not each.path), EXACT)

    def of_field(self, path: str, kind: MessageType | None = None) -> Tolerance:
        """Return what holds for a field: what was said, else nothing for times, else that it has to be equal."""
        for each in self._entries:
            if each.path and names_field(each.path, path):
                return each.tolerance
        all_time = kind is not None and is_brittle(path, kind.name) == "timestamp"  # such as rosgraph_msgs/msg/Clock
        return TIME if all_time or why_brittle(path, kind) in STAMPS else EXACT


class TopicTolerances:
    """What holds for the topics of two logs.

    Args:
        given: Left sides and values: numbers, `1%`, `ignore`; the last one that names a field counts.
        where: The option or file, for errors.

    Raises:
        ConfigError: One is none.
    """

    def __init__(self, given: Sequence[tuple[str, object]] = (), *, where: str = TABLE) -> None:
        self._entries = [_entry(text, value, where) for text, value in given]

    @classmethod
    def of_options(cls, texts: Sequence[str]) -> TopicTolerances:
        """Return what `--tolerance` says; raises ConfigError if a text does not say what is tolerated."""
        given = []
        for text in texts:
            left, equals, value = text.rpartition("=")
            if not equals:
                raise ConfigError(f"{text!r} says no tolerance", where="--tolerance", hint=_HINT)
            given.append((left.strip(), value.strip()))
        return cls(given, where="--tolerance")

    def __add__(self, others: TopicTolerances) -> TopicTolerances:
        both = TopicTolerances()
        both._entries = [*self._entries, *others._entries]
        return both

    def of_topic(self, named: Callable[[str], bool]) -> TolerancesOfTopic:
        """Return what holds for a topic.

        Args:
            named: Says whether a name or key expression includes the topic.
        """
        return TolerancesOfTopic([each for each in reversed(self._entries) if named(each.topic)])

    def unused(self, named: Callable[[str], bool]) -> list[str]:
        """Return those that name no topic; `named` says whether a name or key expression includes any."""
        return [each.text for each in self._entries if not named(each.topic)]


def tolerances_of(texts: Sequence[str], files: Sequence[Path]) -> TopicTolerances:
    """Return what files say and then, which counts more, what options say.

    Args:
        texts: Of `--tolerance`.
        files: Of `--tolerances`.

    Raises:
        ConfigError: One does not say what is tolerated.
    """
    found = TopicTolerances()
    for file in files:
        found += read_tolerances(file)
    return found + TopicTolerances.of_options(texts)


def read_tolerances(path: Path) -> TopicTolerances:
    """Read a file of tolerances.

    Raises:
        ConfigError: It cannot be read, or says something else.
    """
    import tomllib

    try:
        document: Mapping[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the tolerances: {error.strerror}", where=str(path)) from None
    except ValueError as error:  # bytes that are no text, or text that is no TOML
        raise ConfigError(f"not TOML: {error}", where=str(path)) from None
    table = document.get(TABLE)
    if set(document) != {TABLE} or not isinstance(table, Mapping):
        hint = f"write one table [{TABLE}] with lines such as '\"/odom:pose.pose.position.x\" = 0.01'"
        raise ConfigError("this file holds something else than tolerances", where=str(path), hint=hint)
    return TopicTolerances(list(table.items()), where=str(path))


def _entry(text: str, value: object, where: str) -> _Entry:
    topic, path = split_field(text)
    tolerance = _tolerance(value)
    if not topic or tolerance is None or text.endswith(":"):
        raise ConfigError(f"{text!r} = {value!r} says no tolerance", where=where, hint=_HINT)
    return _Entry(text, topic, path, tolerance)


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
