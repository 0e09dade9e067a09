"""The text of definitions in bags: a .msg file, then each dependency after a line of `=` and its name.

Names are written as `pkg/Name`, also those of parts of services and actions: readers of bags accept no others.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from riot_bus_ros2.definitions import fields_of
from riot_bus_ros2.hashes import PLACEHOLDER

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus_ros2.definitions import Definition, Field

_LINE = "=" * 80
_PLAIN = re.compile(r"[\w./:+-](?:[\w ./:+-]*[\w./:+-])?")


def schema_text(name: str, closure: Mapping[str, Definition]) -> str:
    """Return the `ros2msg` text of a type.

    Args:
        closure: Its definition and those of all types in it, in the order of the output.
    """
    parts = [_body(closure[name])]
    parts += (f"{_LINE}\nMSG: {_short(each)}\n{_body(closure[each])}" for each in closure if each != name)
    return "".join(parts)


def _body(definition: Definition) -> str:
    constants = (each for each in definition[0] if not {"\n", "\r"} & set(str(each[2])))  # only .idl can have those
    lines = [f"{kind} {name}={_literal(value)}" for name, kind, value in constants]
    lines += [f"{_type(field)} {field.name}" for field in fields_of(definition) if field.name != PLACEHOLDER]
    return "".join(f"{line}\n" for line in lines)


def _type(field: Field) -> str:
    text = _short(field.content) if field.is_message else field.content
    if field.most_bytes:
        text += f"<={field.most_bytes}"
    if not field.is_array:
        return text
    return f"{text}[{field.length if field.length is not None else f'<={field.most}' if field.most else ''}]"


def _short(name: str) -> str:
    package, _, rest = name.partition("/")
    return f"{package}/{rest.rpartition('/')[2]}"


def _literal(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value)
    if not isinstance(value, str) or _PLAIN.fullmatch(text):
        return text
    quote = '"' if '"' not in text else "'"
    return f"{quote}{text}{quote}"
