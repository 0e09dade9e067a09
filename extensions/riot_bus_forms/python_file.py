"""A rule as a Python file: a predicate, and a function that moves values to the nearest ones without failure."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence

from riot_bus.generalize.forms import standalone
from riot_bus.generalize.forms.python_form import expression_text, term_text
from riot_bus.generalize.forms.repair import unit_of, where_it_changes, why_not_repairable
from riot_bus.generalize.forms.tree import Terms
from riot_bus.generalize.forms.words import identifiers, line
from riot_bus.vocabulary.elements import is_counted

_HEAD = '''\
"""Tells the inputs on which a unit fails, and moves them to the nearest ones on which it does not.

Written by riot_bus. It needs the standard library alone; what stands below the line is the same in all such files.
"""
{told}

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

FIELDS = {{
{fields}
}}
"""Where the arguments come from, in their order, and their types."""


def is_dangerous({arguments}):
    """Return whether the unit fails, as the rule says."""
    return (
        {predicate}
    )


{sanitize}
# ----------------------------------------------------------------------------------------------------------------------

{copy}'''
_SANITIZE = '''\
def sanitize({arguments}):
    """Return the arguments, as a list, such that `is_dangerous` is false; None if no such values are near.

    One value moves as little as possible, in units of its nominal spread; more move only where one will not do.
    """
    return nearest([{arguments}], TERMS, ROOTS, KINDS, UNITS)


TERMS = (
{terms}
)
ROOTS = (
{roots}
)
KINDS = {kinds}
UNITS = {units}

'''


def python_file(terms: Terms, *, types: Mapping[str, str], scale: Mapping[str, float], told: Sequence[str]) -> str:
    """Return the text of a Python file."""
    names = list(types)
    words = identifiers(names)
    arguments = ", ".join(words.values())
    fields = [f"    {words[name]!a}: ({name!a}, {types[name]!a})," for name in names]
    copied = inspect.getsource(standalone)
    return _HEAD.format(
        told="\n".join(f"# {line(each)}" for each in told),
        fields="\n".join(fields),
        arguments=arguments,
        predicate="\n        or ".join(f"({term_text(term, words, types)})" for term in terms) or "False",
        sanitize=_sanitize(terms, names, words, types, scale),
        copy=copied[copied.index("INTEGERS = {") :],
    )


def _sanitize(
    terms: Terms, names: Sequence[str], words: Mapping[str, str], types: Mapping[str, str], scale: Mapping[str, float]
) -> str:
    movable = [name for name in names if not is_counted(name)]
    if why := why_not_repairable(terms, movable, types):
        return f"# No sanitize: {line(why)}\n\n"
    call = f"lambda {', '.join(words.values())}: "
    changes = where_it_changes(terms, movable, types)
    return _SANITIZE.format(
        arguments=", ".join(words.values()),
        terms="\n".join(f"    {call}{term_text(term, words, types)}," for term in terms),
        roots="\n".join(
            f"    ({names.index(name)}, {call}{expression_text(root, words)}, {value!r}),"
            for name, root, value in changes
        ),
        kinds=repr([types[name] for name in names]),
        units=repr([unit_of(scale, name) for name in names]),
    )
