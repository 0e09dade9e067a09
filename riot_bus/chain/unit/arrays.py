"""Arrays of relevant elements, varied as a whole, so that a rule can distinguish one element from any or all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from riot_bus.chain.base.logs import NamedField
from riot_bus.chain.unit.questions import UnitQuestions
from riot_bus.generalize.sampling import Variable
from riot_bus.types.elements import read_elements
from riot_bus.types.model import MessageType
from riot_bus.vocabulary.elements import Elements
from riot_bus.vocabulary.errors import PayloadError

_NOMINAL = 20
"""Number of nominal arrays that are kept, evenly spaced: each has values of many elements."""
_INDEX = re.compile(r"\[(\d+)\](?!.*\[\d+\])", re.DOTALL)


def with_arrays(questions: UnitQuestions, named: Sequence[NamedField], variables: Sequence[Variable]) -> list[Variable]:
    """Return the variables with whole arrays in place of their elements.

    An element stays a variable if its array has no other elements, too many, or not only numbers, or if the array's
    length is a variable, too: then the elements beyond the length decide, not what all elements have in common.
    """
    names = {variable.name for variable in variables}
    arrays: dict[str, Variable] = {}
    found: list[Variable] = []
    for field, variable in zip(named, variables, strict=True):
        index = _INDEX.search(field.leaf.path)
        path = _INDEX.sub("[*]", field.leaf.path)
        prefix = field.name.removesuffix(field.leaf.path)
        if index is None or f"{prefix}len({path.partition('[*]')[0]})" in names:
            found.append(variable)
            continue
        place, name = int(index[1]), prefix + path
        known = arrays.get(name) or _array(questions, field, name, path, variable)
        if known is None:
            found.append(variable)
            continue
        passing = [_with(known.failing, place, value) for value in variable.passing]
        places = tuple(sorted({*known.places, place}))
        dictionary = tuple(dict.fromkeys((*known.dictionary, *variable.dictionary)))
        arrays[name] = replace(known, passing=(*known.passing, *passing), places=places, dictionary=dictionary)
    return [*found, *arrays.values()]


def _array(questions: UnitQuestions, field: NamedField, name: str, path: str, variable: Variable) -> Variable | None:
    failing = _read(field.kind, field.payload, path)
    if failing is None or len(failing) < 2 or variable.type in ("bool", "string", "bytes"):
        return None
    registry = questions.fields.registry
    log = questions.fields.log
    message = log.messages[field.position]
    carried = [one for one in questions.nominal_log() if registry.topic(one.key) == field.topic and one.kind == "put"]
    some = [log.originals.get(message.sequence), *carried[:: max(1, len(carried) // _NOMINAL)][:_NOMINAL]]
    read = [_read(field.kind, one.payload, path) for one in some if one is not None]
    nominal = tuple(one for one in read if one is not None and len(one) == len(failing))
    # encodings without types of numbers write 1.0 as 1
    floats = any(isinstance(value, float) for array in (failing, *nominal) for value in array)
    type_ = "float64" if floats and not variable.type.startswith("float") else variable.type
    return Variable(name, f"{type_}[]", failing, nominal=nominal)


def _read(kind: MessageType, payload: bytes, path: str) -> Elements | None:
    try:
        return read_elements(kind, payload, path)
    except PayloadError:
        return None


def _with(elements: object, place: int, value: object) -> Elements:
    """Return the elements of an array with one of them replaced."""
    assert isinstance(elements, Elements)
    assert isinstance(value, int | float)
    return Elements((*elements[:place], value, *elements[place + 1 :]))
