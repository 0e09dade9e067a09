"""Predicates over the fields of one message: `mode == 2 and (speed > 1.5 or name != "home")`.

Comparisons `path op literal` joined by `and`, `or` and parentheses (`and` binds tighter). Operators are
`== != < <= > >=`; literals are numbers, `true`, `false`, `nan`, `inf` and quoted strings. `x == nan` asks whether x is
not a number. This is a parser, not `eval`: text from a plan runs no code.
"""

from __future__ import annotations

import operator
import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.vocabulary.errors import ConfigError, PayloadError

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.vocabulary.message import Scalar

_TOKEN = re.compile(
    r"""\s*(?:
      (?P<op>==|!=|<=|>=|<|>)
    | (?P<paren>[()])
    | (?P<string>"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')
    | (?P<number>[+-]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|(?:inf|nan)\b))
    | (?P<path>(?:len\([A-Za-z_][\w.\[\]]*\)|[A-Za-z_]\w*(?:\[\d{1,18}\])*(?:\.[A-Za-z_]\w*(?:\[\d{1,18}\])*)*))
    )""",
    re.VERBOSE,
)
_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_DEPTH = 50  # four calls for each level: far below Python's limit of 1000
_LONGEST = 1 << 16
"""Characters: 2,000 comparisons of 32. Parsing that takes 0.1 s, and an error shows the text twice."""


class _Token(NamedTuple):
    kind: str
    text: str
    position: int


@dataclass(frozen=True, slots=True)
class _Comparison:
    path: str
    op: str
    value: bool | float | str

    def __call__(self, read: Callable[[str], Scalar]) -> bool:
        actual, wanted = read(self.path), self.value
        if wanted != wanted and self.op in ("==", "!="):
            return (actual != actual) == (self.op == "==")
        if isinstance(actual, str | bytes) is not isinstance(wanted, str):
            kind = type(actual).__name__
            raise PayloadError(f"cannot compare a {kind} with {wanted!r} in {self.path} {self.op} ...", where=self.path)
        return _OPERATORS[self.op](actual, wanted)


@dataclass(frozen=True, slots=True)
class _Junction:
    every: bool
    parts: tuple[_Comparison | _Junction, ...]

    def __call__(self, read: Callable[[str], Scalar]) -> bool:
        return all(part(read) for part in self.parts) if self.every else any(part(read) for part in self.parts)


@dataclass(frozen=True, slots=True)
class Predicate:
    """A parsed predicate, to be called with a function that reads fields.

    Attributes:
        text: Predicate as the user wrote it.
        fields: Paths that it may read, in order of appearance.
    """

    text: str
    fields: tuple[str, ...]
    _root: _Comparison | _Junction

    def __call__(self, read: Callable[[str], Scalar]) -> bool:
        """Return whether the message meets the predicate; raise PayloadError if a field cannot be compared."""
        try:
            return self._root(read)
        except TypeError as error:  # such as bytes, which have no order with text
            raise PayloadError(str(error)) from error

    def holds(self, read: Callable[[str], Scalar]) -> bool:
        """Return whether the message meets the predicate; one that lacks its fields does not."""
        try:
            return self._root(read)
        except (PayloadError, TypeError):
            return False

    def candidates(self) -> dict[str, list[Scalar]]:
        """Return values of each field, some of which meet the predicate: compared values, and ones near or between."""
        found: dict[str, list[Scalar]] = {path: [] for path in self.fields}
        parts: list[_Comparison | _Junction] = [self._root]
        while parts:
            part = parts.pop()
            if isinstance(part, _Junction):
                parts.extend(part.parts)
            else:
                found[part.path].append(part.value)
        return {path: _around(values) for path, values in found.items()}


def _around(values: list[Scalar]) -> list[Scalar]:
    numbers = sorted(value for value in values if isinstance(value, int | float) and value == value)
    between = [(low + high) / 2 for low, high in pairwise(numbers)]
    beside = [value + step for value in numbers for step in (-1, 1)]
    texts = ["", *(f"{value}_" for value in values if isinstance(value, str))] if len(numbers) < len(values) else []
    truths = [True, False] if any(isinstance(value, bool) for value in values) else []
    return list(dict.fromkeys([*values, *truths, *beside, *between, *texts]))


class _Parser:
    def __init__(self, text: str) -> None:
        self.text = text
        self.fields: list[str] = []
        self._tokens = _tokens(text)
        self._at = 0

    def junction(self, word: str, depth: int = 0) -> _Comparison | _Junction:
        parts = [self._part(word, depth)]
        while self._peek() == ("path", word):
            self._at += 1
            parts.append(self._part(word, depth))
        return parts[0] if len(parts) == 1 else _Junction(word == "and", tuple(parts))

    def end(self) -> None:
        if self._at < len(self._tokens):
            raise self._error("expected 'and', 'or' or the end")

    def _part(self, word: str, depth: int) -> _Comparison | _Junction:
        if word == "or":
            return self.junction("and", depth)
        if self._peek() == ("paren", "("):
            if depth >= _DEPTH:
                raise self._error(f"more than {_DEPTH} nested parentheses")
            self._at += 1
            inside = self.junction("or", depth + 1)
            if self._peek() != ("paren", ")"):
                raise self._error("expected ')'")
            self._at += 1
            return inside
        path = self._expect("path", "a field path")
        if path in ("and", "or", "true", "false", "not"):
            self._at -= 1
            raise self._error(f"expected a field path, found {path!r}")
        op = self._expect("op", "one of == != < <= > >=")
        self.fields.append(path)
        return _Comparison(path, op, self._literal())

    def _literal(self) -> bool | float | str:
        kind, text = self._peek()
        if kind == "number":
            self._at += 1
            digits = text.lower().lstrip("+-")
            if digits.startswith("0x"):
                return int(text, 16)
            try:
                return int(text) if digits.isdecimal() else float(text)
            except ValueError:  # Python's limit of 4,300 digits
                self._at -= 1
                raise self._error("this integer has too many digits") from None
        if kind == "string":
            self._at += 1
            return re.sub(r"\\(.)", r"\1", text[1:-1])
        if (kind, text) in (("path", "true"), ("path", "false")):
            self._at += 1
            return text == "true"
        raise self._error("expected a number, true, false or a quoted string")

    def _peek(self) -> tuple[str, str]:
        return self._tokens[self._at][:2] if self._at < len(self._tokens) else ("end", "")

    def _expect(self, kind: str, what: str) -> str:
        found, text = self._peek()
        if found != kind:
            raise self._error(f"expected {what}")
        self._at += 1
        return text

    def _error(self, problem: str) -> ConfigError:
        at_end = self._at >= len(self._tokens)
        return _error(self.text, len(self.text) if at_end else self._tokens[self._at].position, problem)


def _tokens(text: str) -> list[_Token]:
    tokens = []
    position = 0
    end = len(text.rstrip())
    while position < end:
        match = _TOKEN.match(text, position)
        if match is None or match.lastgroup is None:
            start = len(text) - len(text[position:].lstrip())
            raise _error(text, start, f"cannot read {text[start : start + 12]!r}")
        tokens.append(_Token(match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
        position = match.end()
    return tokens


def _error(text: str, position: int, problem: str) -> ConfigError:
    hint = "write it like 'mode == 2 and speed > 1.5'"
    return ConfigError(
        f"{problem}\n  {text}\n  {' ' * position}^", where=f"predicate, column {position + 1}", hint=hint
    )


@lru_cache(maxsize=1024)
def parse_predicate(text: str) -> Predicate:
    """Parse a predicate.

    Raises:
        ConfigError: The text is not a predicate; the message shows the column.
    """
    if len(text) > _LONGEST:
        raise ConfigError(f"a predicate of {len(text)} characters is too long", hint=f"at most {_LONGEST}")
    parser = _Parser(text)
    root = parser.junction("or")
    parser.end()
    return Predicate(text, tuple(dict.fromkeys(parser.fields)), root)
