"""Names of the values that a rule compares with, and units of its fields, from the definitions of their types."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from riot_bus.chain.base.logs import NamedField
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.types.fields import FieldType
from riot_bus.types.latest import in_words
from riot_bus.types.listing import describe

_INDEX = re.compile(r"\[\d+\]")
_BITS = "bits"


def legend_of(rule: Rule, fields: Mapping[str, NamedField], topics: Sequence[str]) -> tuple[str, ...]:
    """Return names of the rule's values and units of its fields, in the order of the rule; at most twelve."""
    known = {name: found for name in rule.variables if name in fields and (found := _described(fields[name]))}
    lines = (
        line
        for term in rule.terms
        for literal in term
        for name in literal.feature.args
        if name in known
        for line in _lines(in_words(name, topics), known[name], literal)
    )
    return tuple(dict.fromkeys(lines))[:12]


def _lines(shown: str, field: FieldType, literal: Literal) -> Iterator[str]:
    if field.unit:
        yield f"{shown} is in {field.unit}"
    values: object = literal.feature.constant if literal.feature.kind == _BITS else literal.value
    if literal.feature.kind not in ("raw", _BITS):
        return
    names = dict(field.names)
    for value in values if isinstance(values, tuple) else (values,):
        if isinstance(value, int | float) and not isinstance(value, bool) and value in names:
            yield f"{int(value)} of {shown} is {names[int(value)]}"


def _described(field: NamedField) -> FieldType | None:
    """Return what the definition of its type says of a field; None if there is none."""
    path = _INDEX.sub("[*]", field.leaf.path)
    return next((each for each in describe(field.kind).fields if each.path == path), None)
