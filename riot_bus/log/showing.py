"""Shows a short log field by field, with changed values beside the original ones."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus.log.reader import LogReader
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message, Scalar

_ELEMENTS, _CHANGED = 4, 64
"""Most elements of each array that are shown, and that are checked for changes."""
_INDEX = re.compile(r"\[(\d+)\]")
_FIELDS = 40  # about a screen; changed fields come first, and the rest is counted
_LONGEST = 80  # a changed field has two values in its line


@dataclass(frozen=True, slots=True)
class ShownField:
    """One field: its value and, if that was changed, the value before; None where there is none."""

    path: str
    value: Scalar | None
    before: Scalar | None = None
    changed: bool = False


@dataclass(frozen=True, slots=True)
class ShownMessage:
    """One message.

    Attributes:
        number: Position among the delivered messages, from 0; None if it was not delivered.
        seconds: Seconds since the first message of the log.
        fields: Fields, changed ones first, up to a limit.
        more: Number of fields that are not among them.
        note: Further remarks, such as why there are no fields.
    """

    number: int | None
    seconds: float
    topic: str
    type: str
    fields: tuple[ShownField, ...]
    more: int = 0
    note: str = ""


@dataclass(frozen=True, slots=True)
class ShownLog:
    """Messages of a log: all, or if there are too many, the changed ones, or the first ones if none was changed.

    Attributes:
        total: Number of delivered messages in the log.
        modified: Number of messages that were changed or dropped.
        left_out: Number of changed messages that are not shown.
    """

    messages: tuple[ShownMessage, ...]
    total: int
    modified: int
    left_out: int

    def lines(self) -> Iterator[str]:
        """Yield the view as lines of text; changed fields are marked `*`."""
        shown = sum(each.number is not None for each in self.messages)
        rest = "" if shown == self.total else "; these are shown" if self.modified else f"; the first {shown} are shown"
        yield f"{counted(self.total, 'message')}, {self.modified} changed{rest}"
        for message in self.messages:
            number = "dropped" if message.number is None else f"#{message.number}"
            note = f"  ({message.note})" if message.note else ""
            yield f"{number}  {message.seconds:+.3f} s  {message.topic}  {message.type}{note}"
            width = max((len(each.path) for each in message.fields), default=0)
            for each in message.fields:
                was = f"{value_text(each.before)} -> " if each.changed else ""
                yield f"  {'*' if each.changed else ' '} {each.path:{width}}  {was}{value_text(each.value)}"
            if message.more:
                yield f"    ... {counted(message.more, 'further field')}"
        if self.left_out:
            yield f"... {counted(self.left_out, 'further changed message')}"

    def to_json(self) -> dict[str, Any]:
        """Return the view as JSON values; bytes are hex text."""
        return {
            "total": self.total,
            "modified": self.modified,
            "left_out": self.left_out,
            "messages": [
                {
                    "number": each.number,
                    "seconds": each.seconds,
                    "topic": each.topic,
                    "type": each.type,
                    "note": each.note,
                    "more": each.more,
                    "fields": [
                        {"path": one.path, "value": _json(one.value)}
                        | ({"before": _json(one.before)} if one.changed else {})
                        for one in each.fields
                    ],
                }
                for each in self.messages
            ],
        }


def show_log(reader: LogReader, *, registry: TypeRegistry, most: int = 20) -> ShownLog:
    """Return a view of a log with a limited number of messages."""
    total = sum(1 for _ in reader.messages())
    originals: dict[int, Message] = {}
    modified = 0
    for each in reader.originals():
        modified += 1
        if len(originals) < most:
            originals[each.sequence] = each
    shown: list[tuple[int, ShownMessage]] = []
    first: int | None = None
    waiting = dict(originals)
    for number, message in enumerate(reader.messages()):
        first = message.time if first is None else first
        original = waiting.pop(message.sequence, None)
        if total <= most or original is not None or (not modified and number < most):
            shown.append((message.time, _shown(number, message, original, first, registry)))
        if total > most and not waiting and (modified or number >= most):
            break
    start = first if first is not None else min((each.time for each in waiting.values()), default=0)
    shown += [(each.time, _shown(None, each, None, start, registry)) for each in waiting.values()]
    messages = tuple(each for _, each in sorted(shown, key=lambda one: one[0])[:most])
    return ShownLog(messages, total, modified, max(0, modified - len(originals)))


def _shown(
    number: int | None, message: Message, original: Message | None, first: int, registry: TypeRegistry
) -> ShownMessage:
    kind = registry.type_of_message(message)
    fields, notes = _values(message, registry, _ELEMENTS if original is None else _CHANGED)
    before: dict[str, Scalar] = {}
    if original is not None:
        before, _ = _values(original, registry, _CHANGED)
        if original.payload != message.payload and (not before or not fields):
            notes = f"{len(original.payload)} -> {len(message.payload)} bytes; {notes}".rstrip("; ")
        if original.time != message.time:
            notes = f"{(message.time - original.time) / 1e9:+.3f} s; {notes}".rstrip("; ")
    listed = [
        ShownField(path, fields.get(path), before.get(path), changed=not _same(fields.get(path), before.get(path)))
        if before and fields
        else ShownField(path, fields[path])
        for path in dict.fromkeys([*fields, *(before if fields else ())])
    ]
    listed = [each for each in listed if each.changed or not _far(each.path)]
    hidden = len(fields) - len(listed)
    listed.sort(key=lambda each: not each.changed)
    return ShownMessage(
        number,
        (message.time - first) / 1e9,
        registry.topic(message.key),
        kind.name if kind else "",
        tuple(listed[:_FIELDS]),
        max(0, hidden) + max(0, len(listed) - _FIELDS),
        notes,
    )


def _values(message: Message, registry: TypeRegistry, elements: int) -> tuple[dict[str, Scalar], str]:
    if message.kind == "delete":
        return {}, "delete"
    kind = registry.type_of_message(message)
    if kind is None:
        return {}, f"{len(message.payload)} bytes of an unknown type"
    try:
        return {leaf.path: leaf.value for leaf in kind.leaves(message.payload, elements=elements)}, ""
    except PayloadError as error:
        return {}, f"{len(message.payload)} bytes: {error.message}"


def _far(path: str) -> bool:
    return any(int(index) >= _ELEMENTS for index in _INDEX.findall(path))


def _same(left: Scalar | None, right: Scalar | None) -> bool:
    return type(left) is type(right) and (left == right or (left != left and right != right))


def _json(value: Scalar | None) -> bool | int | float | str | None:
    return value.hex() if isinstance(value, bytes) else value


def value_text(value: Scalar | None) -> str:
    """Return a value as text that fits in a line."""
    if value is None:
        return "(none)"
    shown = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(_json(value))
    return shown if len(shown) <= _LONGEST else f"{shown[: _LONGEST - 4]} ..."
