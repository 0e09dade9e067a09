"""Parses and applies changes of fields: `TOPIC:FIELD = VALUE`, or `+=`, `-=`, `*=`, `/=` a number, and conditions.

Integers wrap to the bits of their type and floats become infinite when they overflow, as `MessageType.rebuild` says.
"""

from __future__ import annotations

import json
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from riot_bus.types.elements import fit_value, set_field
from riot_bus.types.model import MessageType, parse_path
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Scalar
from riot_bus_logtools.editing.selection import Selection, parse_clauses

Operator = Literal["=", "+=", "-=", "*=", "/="]
_OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+=": operator.add,
    "-=": operator.sub,
    "*=": operator.mul,
    "/=": operator.truediv,
}

_TEXT = re.compile(
    r"\s*(?P<topic>\S(?:.*?\S)?)\s*:(?P<field>(?:len\()?[A-Za-z_\[][^:=/\s]*?)\s*(?P<op>[-+*/]?=)(?!=)\s*(?P<rest>\S.*)",
    re.DOTALL,
)
_VALUE = re.compile(
    r"""(?P<value>"(?:[^"\\]|\\.)*"|'[^']*'|.*?)\s*(?P<clauses>(?<=\s)(?:during|index|every|where)\s.*)?""", re.DOTALL
)
_HINT = "write TOPIC:FIELD=VALUE, such as '/odom:twist.twist.linear.x = nan where pose.pose.position.x > 3'"


@dataclass(frozen=True, slots=True)
class Assignment:
    """A change of one field in some messages of a log, such as `/odom:pose.pose.position.x += 0.5 index 3..7`.

    `[*]` in the path stands for all elements; other operators than `=` take a number.
    """

    text: str
    selection: Selection
    field: str
    operator: Operator
    value: Scalar

    def applied(self, kind: MessageType, payload: bytes) -> bytes:
        """Return the payload with the field changed; raises PayloadError if it is missing or the value does not fit."""
        return set_field(kind, payload, self.field, self._changed)

    def shortcut(self, kind: MessageType, payload: bytes) -> Callable[[bytes], bytes] | None:
        """Return a function that does to payloads what `applied` does, faster; None if there is none.

        There is one only if every message gets the same value at the same bytes; the payload shows its present type.
        """
        patcher = getattr(kind, "patcher", None)
        if patcher is None or self.operator != "=" or "[*]" in self.field:
            return None
        patch: Callable[[bytes], bytes] | None = patcher(self.field, self._changed(kind.read(payload, self.field)))
        return patch

    def _changed(self, before: Scalar) -> Scalar:
        if self.operator == "=":
            if isinstance(before, str) and not isinstance(self.value, str):
                return str(self.value).lower() if isinstance(self.value, bool) else str(self.value)
            return fit_value(self.value, before)
        if isinstance(before, bool | str | bytes) or not isinstance(self.value, int | float):
            raise PayloadError(f"{before!r} is not a number", where=self.field)
        operation = _OPERATIONS[self.operator]
        if isinstance(before, int) and isinstance(self.value, int) and self.operator != "/=":
            return int(operation(before, self.value))
        try:
            after = float(operation(float(before), float(self.value)))
            return round(after) if isinstance(before, int) else after
        except OverflowError:
            if isinstance(before, int):
                raise PayloadError(
                    f"{before} {self.operator} {self.value} is not an integer", where=self.field
                ) from None
            return math.inf
        except ValueError:
            raise PayloadError(f"{self.value} does not fit into an integer", where=self.field) from None


def parse_assignment(text: str, option: str) -> Assignment:
    """Parse `TOPIC:FIELD OPERATOR VALUE [conditions]`; raises ConfigError if it is not of this form."""
    match = _TEXT.fullmatch(text)
    parts = _VALUE.fullmatch(match["rest"]) if match else None
    if match is None or parts is None or not parts["value"]:
        raise ConfigError(f"{text!r} does not say what to set", where=option, hint=_HINT)
    field, operation, value = match["field"], match["op"], _value(parts["value"], option)
    try:
        parsed = parse_path(field.replace("[*]", "[0]"))
    except PayloadError as error:
        raise ConfigError(error.message, where=option, hint=error.hint) from None
    if parsed.length:
        raise ConfigError(f"{field}: a length cannot be changed", where=option)
    if operation != "=":
        if isinstance(value, str | bool | bytes) or not math.isfinite(value):
            raise ConfigError(f"{parts['value']} in {text!r} is not a number to calculate with", where=option)
        if operation == "/=" and not value:
            raise ConfigError(f"{text!r} divides by zero", where=option)
    selection = parse_clauses(match["topic"], parts["clauses"] or "", text, option)
    return Assignment(text, selection, field, operation, value)  # type: ignore[arg-type]


def _value(text: str, option: str) -> Scalar:
    if text[0] == '"' and len(text) > 1:
        try:
            return str(json.loads(text, strict=False))
        except ValueError:
            raise ConfigError(f"{text} is not a quoted text", where=option) from None
    if text[0] == "'" and len(text) > 1:
        return text[1:-1]
    if text in ("true", "false"):
        return text == "true"
    for convert in (int, float, lambda digits: int(digits, 16)):
        try:
            return convert(text)
        except ValueError:
            continue
    return text
