"""The JSON form of rules. The input may be untrusted: everything is checked, nothing is evaluated."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal, Value
from riot_bus.vocabulary.errors import ConfigError

VERSION = 1
MOST_TERMS = 64  # 16 times what is learnt (`beam.MOST_TERMS`); bounds the work that an untrusted rule causes
LONGEST_NAME = 1024  # a guess: longer than names of fields; bounds the size of an untrusted rule
LONGEST_TEXT = 1 << 21  # twice the longest text that dictionaries try; what has been written has to be read
LARGEST_INTEGER = 2**193  # products of three numbers with 64 bits stay below it, and sums of four products of two

Terms = tuple[tuple[Literal, ...], ...]


def encode(terms: Terms) -> dict[str, Any]:
    """Return the JSON object of a rule's terms."""
    return {
        "format": "riot-rule",
        "version": VERSION,
        "terms": [[_encode_literal(literal) for literal in term] for term in terms],
    }


def _encode_literal(literal: Literal) -> dict[str, Any]:
    found = {
        "feature": literal.feature.kind,
        "args": list(literal.feature.args),
        "operator": literal.operator,
        "value": _encode_value(literal.value),
    }
    if literal.feature.constant is not None:
        found["constant"] = _encode_value(literal.feature.constant)
    return found


def _encode_value(value: Value) -> Any:
    if isinstance(value, tuple):
        return [_encode_value(member) for member in value]
    return {"bytes": value.hex()} if isinstance(value, bytes) else value


def decode(source: str | bytes | Mapping[str, Any]) -> Terms:
    """Return the terms of a rule.

    Raises:
        ConfigError: If the source is not a rule of a known version.
    """
    data: Any = source
    if isinstance(source, str | bytes):
        try:
            data = json.loads(source)
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"the rule is not JSON: {error}") from error
    if not isinstance(data, Mapping) or data.get("format") != "riot-rule":
        raise ConfigError("this is not a rule", hint='a rule is a JSON object with "format": "riot-rule"')
    if type(data.get("version")) is not int or data["version"] != VERSION:
        raise ConfigError(f"rule version {data.get('version')!r} is not known", hint=f"this release reads {VERSION}")
    terms = _list(data.get("terms"), "terms")
    return tuple(
        tuple(_decode_literal(item, f"terms[{row}][{column}]") for column, item in enumerate(_list(term, "term")))
        for row, term in enumerate(terms)
    )


def _list(value: Any, what: str) -> list[Any]:
    if not isinstance(value, list) or len(value) > MOST_TERMS:
        raise ConfigError(f"{what} of a rule must be a list of at most {MOST_TERMS} entries")
    return value


def _decode_literal(data: Any, where: str) -> Literal:
    keys = {"feature", "args", "operator", "value"}
    if not isinstance(data, Mapping) or set(data) - {"constant"} != keys:
        raise ConfigError("a literal has feature, args, operator, value and maybe constant, no more", where=where)
    kind, args, operator = data["feature"], data["args"], data["operator"]
    names = isinstance(args, list) and all(isinstance(name, str) and len(name) <= LONGEST_NAME for name in args)
    if not isinstance(kind, str) or not isinstance(operator, str) or not names:
        raise ConfigError("feature and operator are strings, args a list of names", where=where)
    try:
        constant = _decode_value(data["constant"]) if "constant" in data else None
        return Literal(Feature(kind, tuple(args), constant), operator, _decode_value(data["value"]))  # type: ignore[arg-type]
    except ConfigError as error:
        raise ConfigError(error.message, where=where, hint=error.hint) from error


def _decode_value(value: Any) -> Value:
    if isinstance(value, list):
        return tuple(_decode_scalar(member) for member in _list(value, "a set"))
    scalar: Value = _decode_scalar(value)
    return scalar


def _decode_scalar(value: Any) -> Any:
    if isinstance(value, Mapping):
        text = value.get("bytes")
        if set(value) != {"bytes"} or not isinstance(text, str) or len(text) > 2 * LONGEST_TEXT:
            hint = f'write {{"bytes": "00ff"}}, at most {LONGEST_TEXT:,} bytes'
            raise ConfigError("an object as value can only be bytes in hexadecimal", hint=hint)
        try:
            return bytes.fromhex(text)
        except ValueError as error:
            raise ConfigError(f"not hexadecimal: {text[:40]!r}") from error
    if value is None or isinstance(value, bool | float):
        return value
    if isinstance(value, int):
        if abs(value) > LARGEST_INTEGER:
            raise ConfigError(f"an integer of {value.bit_length()} bits is too large", hint="at most 2**193 is allowed")
        return value
    if isinstance(value, str):
        if len(value) > LONGEST_TEXT:
            raise ConfigError(f"a text of {len(value):,} characters is too long; at most {LONGEST_TEXT:,} are allowed")
        return value
    hint = 'a value is null, true, false, a number, a text or {"bytes": "<hexadecimal digits>"}'
    raise ConfigError(f"a {type(value).__name__} is not a single value", hint=hint)
