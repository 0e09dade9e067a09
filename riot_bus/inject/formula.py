"""Formulas over the fields of one message: `len(data) == step * height`, `width + 1`, `'rgb8'`.

Arithmetic (`+ - * / // % **`), comparisons, `and`, `or`, `not`, `abs`, `min`, `max`, `isfinite`, numbers, quoted text,
`true`, `false`, `nan`, `inf`, and field paths such as `pose.covariance[7]` and `len(data)`. The syntax is
that of Python, so its parser reads them; the syntax tree is checked node by node, and never executed by Python.
"""

from __future__ import annotations

import ast
import math
import operator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.vocabulary.injection import Formula
    from riot_bus.vocabulary.message import Scalar

    Read = Callable[[str], Scalar]
    Node = Callable[[Read], Any]

_LONGEST = 1000  # paths such as `a.a.a` nest 500 deep at most; Python recurses 1000 deep
_DEEPEST = 40  # a level takes up to three frames of the 1000 that Python recurses
_BITS = 4096  # `9 ** 9 ** 9` would take 150 MB; most fields have 64 bits or fewer
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {"abs": abs, "isfinite": math.isfinite, "max": max, "min": min}
_CONSTANTS: dict[str, float | bool] = {"nan": math.nan, "inf": math.inf, "true": True, "false": False}


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed formula; call it with a function that reads fields.

    Attributes:
        text: Text of the formula, as it was written.
        fields: Every path that it may read, in order of appearance.
        literal: The quoted text, if the formula is nothing else.
    """

    text: str
    fields: tuple[str, ...]
    literal: str | None
    _root: Node

    def __call__(self, read: Read) -> Scalar:
        """Return the value for one message.

        Raises:
            PayloadError: A field is missing, or of a kind that cannot be calculated with.
        """
        try:
            value = self._root(read)
        except (ArithmeticError, TypeError, ValueError) as error:
            if isinstance(error, PayloadError):
                raise
            raise PayloadError(f"{self.text!r} has no value here: {error}") from error
        if not isinstance(value, bool | int | float | str | bytes):
            raise PayloadError(f"{self.text!r} has no value here")
        return value


def join_path(base: str, path: str) -> str:
    """Return the path of a nested field: `join_path("a[0].b", "len(c)")` is `len(a[0].b.c)`."""
    if not base:
        return path
    return f"len({base}.{path[4:-1]})" if path.startswith("len(") else f"{base}.{path}"


def evaluate(formula: Formula, read: Read) -> Scalar:
    """Return the value of a formula for one message; raises as `Expression` and `parse_formula` do."""
    return parse_formula(formula.text)(lambda path: read(join_path(formula.base, path)))


@lru_cache(maxsize=1024)
def parse_formula(text: str) -> Expression:
    """Parse a formula.

    Raises:
        ConfigError: The text is not a formula; the message shows the column.
    """
    if len(text) > _LONGEST:
        raise ConfigError(f"a formula of {len(text)} characters is too long", where="formula")
    try:
        body = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        column = getattr(error, "offset", None) or 1
        raise _error(text, column, "cannot read this") from None
    compiler = _Compiler(text)
    root = compiler.node(body, 0)
    literal = body.value if isinstance(body, ast.Constant) and isinstance(body.value, str) else None
    return Expression(text, tuple(dict.fromkeys(compiler.fields)), literal, root)


class _Compiler:
    def __init__(self, text: str) -> None:
        self.text = text
        self.fields: list[str] = []

    def node(self, tree: ast.expr, depth: int) -> Node:
        if depth > _DEEPEST:
            raise self.error(tree, f"nested deeper than {_DEEPEST}")
        path = self.path(tree)
        if path is not None:
            if path in _CONSTANTS:
                constant = _CONSTANTS[path]
                return lambda _read: constant
            self.fields.append(path)
            return lambda read: read(path)
        match tree:
            case ast.Constant(value=bool() | int() | float() | str() as value):
                return lambda _read: value
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _reckoned(type(op), self.node(left, depth + 1), self.node(right, depth + 1))
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=operand):
                inner = self.node(operand, depth + 1)
                sign = operator.neg if isinstance(op, ast.USub) else operator.pos
                return lambda read: sign(_number(inner(read)))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                denied = self.node(operand, depth + 1)
                return lambda read: not denied(read)
            case ast.BoolOp(op=op, values=values):
                parts = [self.node(each, depth + 1) for each in values]
                every = isinstance(op, ast.And)
                return lambda read: (all if every else any)(part(read) for part in parts)
            case ast.Compare(left=left, ops=ops, comparators=comparators):
                return self.comparison(tree, [left, *comparators], ops, depth)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS and arguments:
                function = _FUNCTIONS[name]
                given = [self.node(each, depth + 1) for each in arguments]
                return lambda read: function(*(_number(each(read)) for each in given))
            case ast.Call(func=ast.Name(id=name)):
                known = ("len", *_FUNCTIONS)
                raise self.error(tree, f"no function {name!r} of a field here", hint=did_you_mean(name, known))
        raise self.error(tree, "this is not a formula")

    def comparison(self, tree: ast.expr, operands: list[ast.expr], ops: list[ast.cmpop], depth: int) -> Node:
        if not all(type(op) in _COMPARISONS for op in ops):
            raise self.error(tree, "compare with == != < <= > >=")
        nodes = [self.node(each, depth + 1) for each in operands]
        compare = [_COMPARISONS[type(op)] for op in ops]

        def check(read: Read) -> bool:
            values = [node(read) for node in nodes]
            return all(holds(left, right) for holds, left, right in zip(compare, values, values[1:], strict=False))

        return check

    def path(self, tree: ast.expr) -> str | None:
        """Return the field path that a node spells, or None if it is something else."""
        match tree:
            case ast.Name(id=name):
                return name
            case ast.Attribute(value=value, attr=name):
                inner = self.path(value)
                return None if inner is None else f"{inner}.{name}"
            case ast.Subscript(value=value, slice=ast.Constant(value=int() as index)) if not isinstance(index, bool):
                inner = self.path(value)
                return None if inner is None else f"{inner}[{index}]"
            case ast.Call(func=ast.Name(id="len"), args=[argument], keywords=[]):
                inner = self.path(argument)
                return None if inner is None else f"len({inner})"
        return None

    def error(self, tree: ast.expr, problem: str, *, hint: str | None = None) -> ConfigError:
        return _error(self.text, tree.col_offset + 1, problem, hint)


def _reckoned(kind: type[ast.operator], left: Node, right: Node) -> Node:
    work = _ARITHMETIC[kind]
    power = kind is ast.Pow

    def reckon(read: Read) -> Any:
        one, two = _number(left(read)), _number(right(read))
        if power and isinstance(one, int) and isinstance(two, int) and one.bit_length() * abs(two) > _BITS:
            raise OverflowError("the number is too large")
        value = work(one, two)
        if isinstance(value, int) and value.bit_length() > _BITS:
            raise OverflowError("the number is too large")
        return value

    return reckon


def _number(value: Any) -> int | float:
    if not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return value


def _error(text: str, column: int, problem: str, hint: str | None = None) -> ConfigError:
    hint = hint or "write it like 'len(data) == step * height' or 'width + 1'; literal text in quotes of its own"
    shown = f"{problem}\n  {text}\n  {' ' * (column - 1)}^"
    return ConfigError(shown, where=f"formula, column {column}", hint=hint)
