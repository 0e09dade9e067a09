"""Errors that components write: to stdout, to stderr, and to the topic /rosout."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal

from pydantic import Field

from riot_bus.monitors.model import TrialView
from riot_bus.monitors.selection import selected
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.selector import Selector
from riot_bus.vocabulary.trial import Violation

_LEVELS: Final = {"warn": 30, "error": 40, "fatal": 50}  # as in rcl_interfaces/msg/Log
_WORDS: Final = {
    "warn": "WARN|WARNING|ERROR|FATAL|CRITICAL",
    "error": "ERROR|FATAL|CRITICAL",
    "fatal": "FATAL|CRITICAL",
}
_ROS_TOPIC = "/rosout"
_ROS_LINE = re.compile(r"\[[A-Z]+\] \[[0-9.]+\] \[([^\]]+)\]: (.*)")
_LONGEST_LINE = 400  # the steps of two repeats grow with its cube, here to 10^7 a line
_SECONDS = 5.0  # a guess: what a slow pattern may cost a trial with many lines
_REPEATS, _OPTIONAL = 2, 8  # a third repeat takes 100 times as long; each `?` doubles the ways
_QUANTIFIER = re.compile(r"(?:[*+?]|\{[0-9,]+\})[?+]?")
_CLASS = re.compile(r"\[\^?\]?(?:\\.|[^\]\\])*\]")
_SHAPES = (
    (re.compile(r"\x1b\[[0-9;]*[A-Za-z]"), ""),
    (re.compile(r'"[^"]*"|(?<!\w)\'[^\']*\''), "'...'"),
    (re.compile(r"\b0x[0-9a-fA-F]+\b|\b(?=[0-9a-f-]*[0-9])[0-9a-f]{8}[0-9a-f-]*\b"), "N"),
    (re.compile(r"(?<![\w.])(?:[A-Za-z]:)?[/\\][\w.+/\\-]*\w(?::\d+)*"), "PATH"),
    (re.compile(r"(?:(?<!\w)[-+])?(?<![A-Za-z_])\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"), "N"),
    (re.compile(r"\s+"), " "),
)


@dataclass(frozen=True)
class Log:
    """No component writes an error.

    Only the first 400 characters of each line count. To bound the search, `pattern` may hold at most two repeats (`*`,
    `+`, `{m,n}`) and eight `?`, none of them inside a group that is itself repeated. After 5 seconds the monitor gives
    up, which is reported.

    Attributes:
        pattern: Regular expression for lines of stdout and stderr; None for a word such as ERROR or FATAL in capitals.
        level: Lowest level that counts, for these words and for messages of /rosout.
    """

    pattern: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    level: Literal["warn", "error", "fatal"] = "error"

    def __post_init__(self) -> None:
        if self.pattern is not None:
            _check(self.pattern)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topic of ROS 2 logs."""
        return (_ROS_TOPIC,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation for each kind of line, at most 20."""
        wanted = re.compile(self.pattern or rf"(?<![A-Za-z])(?:{_WORDS[self.level]})(?![A-Za-z])")
        deadline = time.monotonic() + _SECONDS
        found: dict[str, Violation] = {}
        for component, text, fixed in self._lines(view):
            if time.monotonic() > deadline:
                raise PayloadError(f"the lines of {component} took more than {_SECONDS:g} s", hint="a simpler pattern")
            if len(found) < 20 and (fixed or wanted.search(text)):
                ros = _ROS_LINE.search(text)
                who, said = (ros[1], ros[2]) if ros else (component, text)
                signature = f"log of {who}: {normalized(said)}"
                found.setdefault(signature, Violation("log", component, signature, text.strip()))
        return list(found.values())

    def unseen(self, view: TrialView) -> str | None:
        """Return that nothing was written, None if something was."""
        written = any(component.errors or component.printed for component in view.components)
        return None if written or any(self._ros(view)) else "no component wrote anything"

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with one more line; raises PayloadError if no text is found that the pattern matches."""
        line = (
            f"{self.level.upper()}: forged"
            if self.pattern is None
            else re.sub(r"\\[bB]|[\^$()?*+\\]", "", self.pattern)
        )
        if self.pattern is not None and not re.search(self.pattern, line):
            raise PayloadError(f"cannot be shown: no text is known that {self.pattern!r} matches")
        if not view.components:
            raise PayloadError("there is no component that could write")
        first, *others = view.components
        return replace(view, components=[replace(first, errors=f"{first.errors}\n{line}\n"), *others])

    def _lines(self, view: TrialView) -> Iterator[tuple[str, str, bool]]:
        for component in view.components:
            for text in (component.errors, component.printed):
                for line in text.splitlines():
                    yield component.name, line[:_LONGEST_LINE], False
        for level, name, text in self._ros(view):
            if level >= _LEVELS[self.level]:
                yield name, f"[LEVEL] [0] [{name}]: {text}"[:_LONGEST_LINE].partition("\n")[0], True

    def _ros(self, view: TrialView) -> Iterator[tuple[int, str, str]]:
        for message, kind in selected(view, Selector(_ROS_TOPIC)):
            level, name, text = (kind.read(message.payload, field) for field in ("level", "name", "msg"))
            yield int(level), str(name), str(text)


def normalized(line: str) -> str:
    """Return a line without what changes from trial to trial: numbers, addresses, paths, quoted texts, colours."""
    for shape, instead in _SHAPES:
        line = shape.sub(instead, line)
    return line.strip()[:160]


def _check(pattern: str) -> None:
    """Raise ConfigError for an invalid pattern, or one whose search may take very long."""
    try:
        re.compile(pattern)
    except re.error as error:
        raise ConfigError(f"pattern {pattern!r}: {error}") from error
    plain = _CLASS.sub("x", re.sub(r"\\.", "x", pattern))
    plain = re.sub(r"\(\?(?:[a-zA-Z:=!>#-]|<[=!]|P<\w+>)*", "(", plain)
    found = [match[0] for match in _QUANTIFIER.finditer(plain)]
    repeats = sum(not text.startswith("?") for text in found)
    opened: list[bool] = []  # for each open group, whether it has a quantifier inside
    for place, sign in enumerate(plain):
        if sign == "(":
            opened.append(False)
        elif sign == ")" and opened:
            inside = opened.pop()
            if inside and _QUANTIFIER.match(plain, place + 1):
                raise ConfigError(f"pattern {pattern!r} repeats a group that repeats something", hint="see docs: `log`")
            if opened:
                opened[-1] |= inside
        elif opened and sign in "*+?{":
            opened[-1] = True
    if repeats > _REPEATS or len(found) - repeats > _OPTIONAL:
        raise ConfigError(f"pattern {pattern!r} has more than {_REPEATS} repeats or {_OPTIONAL} '?'")
