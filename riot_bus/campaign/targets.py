"""Fields of a log that may be changed (all but brittle ones and those that the user excludes), and values for them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

from riot_bus.campaign.sentences import structured
from riot_bus.types.brittle import why_brittle
from riot_bus.types.capabilities import SuggestedValue, suggested_values
from riot_bus.types.model import family_of
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.field_pattern import names_field

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.types.model import Leaf, MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message, Scalar

ELEMENTS = 4
"""Number of elements of each array that are targets of their own."""
_PLACES = 64
"""Elements of an array, or of nested arrays, that injections may reach: more make a campaign slow to prepare."""
_INDEX = re.compile(r"\[(\d+)\]")
_SAMPLES = 200
"""Messages of a topic that are read for fields and limits: a second at most for large messages."""
_OTHERS = 4
"""Number of texts of the field itself, and of values of other fields of its message, that are tried."""
MOST_ADDED_BYTES = 1 << 26
"""Most bytes that a change may add to all messages of a trial."""
_LONG = 4096
"""Texts of this length or longer are not tried elsewhere: each test case would hold them."""


class TypedPayload(NamedTuple):
    """A message's type and payload."""

    kind: MessageType
    payload: bytes

    def leaves(self, elements: int = 16) -> Sequence[Leaf]:
        """Return the fields of the payload, with as many elements of each array; none if it cannot be read."""
        try:
            return self.kind.leaves(self.payload, elements=elements)
        except PayloadError:
            return ()


@dataclass(frozen=True, slots=True)
class Target:
    """One field that may be injected, and the number of messages of its topic.

    Attributes:
        told: Values that its definition suggests.
        elements: Paths of elements all over its array; empty if it is in no array.
    """

    topic: str
    path: str
    type: str
    messages: int
    told: tuple[SuggestedValue, ...] = ()
    elements: tuple[str, ...] = field(default=(), compare=False)


def targets_of(
    messages: Sequence[Message], registry: TypeRegistry, *, leave: Sequence[str] = (), include: Sequence[str] = ()
) -> dict[str, list[Target]]:
    """List the fields of a log that injections may change, by topic.

    Those that match `leave` are left out, and so are stamps, sequence numbers and frame ids that match no `include`.
    """
    targets: dict[str, list[Target]] = {}
    for topic, (count, samples) in samples_by_topic(messages, registry).items():
        fields: dict[str, str] = {}
        told: dict[str, dict[object, SuggestedValue]] = {}
        kinds: dict[str, MessageType] = {}
        elements: dict[str, tuple[str, ...]] = {}

        def may(path: str, kind: MessageType, topic: str = topic) -> bool:
            return may_change(topic, path, leave, include, kind=kind)

        for sample in samples:
            kind, payload = sample
            lengths: dict[str, int] = {}
            for leaf in sample.leaves(ELEMENTS):
                if leaf.path.startswith("len("):
                    continue
                fields.setdefault(leaf.path, leaf.type)
                kinds.setdefault(leaf.path, kind)
                if (family := family_of(leaf.path)) not in elements:
                    paths = _elements(kind, payload, leaf.path, lengths)
                    elements[family] = tuple(each for each in paths if may(each, kind))
                for entry in suggested_values(kind, payload, leaf.path):
                    told.setdefault(leaf.path, {}).setdefault(repr(entry.value), entry)
        chosen = [
            Target(topic, path, type_name, count, tuple(told.get(path, {}).values()), elements[family_of(path)])
            for path, type_name in fields.items()
            if may(path, kinds[path])
        ]
        if chosen:
            targets[topic] = chosen
    return targets


def spread(length: int, most: int) -> list[int]:
    """Return at most `most` indices of an array, evenly spaced from the first to the last."""
    if length <= most:
        return list(range(length))
    return [round(number * (length - 1) / (most - 1)) for number in range(most)]


def _elements(kind: MessageType, payload: bytes, path: str, lengths: dict[str, int]) -> list[str]:
    """Return paths of elements evenly spaced over the arrays of a path; none if it has no array."""
    arrays = [path[: each.start()] for each in _INDEX.finditer(path)]
    if not arrays:
        return []
    try:
        lengths |= {each: int(kind.read(payload, f"len({each})")) for each in arrays if each not in lengths}
    except PayloadError:  # the apparent index is part of a quoted name
        return []
    most = max(2, round(_PLACES ** (1 / len(arrays))))
    return [_at(path, each) for each in product(*(spread(lengths[array], most) for array in arrays))]


def _at(path: str, indices: Iterable[int]) -> str:
    left = iter(indices)
    return _INDEX.sub(lambda _: f"[{next(left)}]", path)


def samples_by_topic(messages: Sequence[Message], registry: TypeRegistry) -> dict[str, tuple[int, list[TypedPayload]]]:
    """Return for each topic, sorted, its number of messages, and samples of about `_SAMPLES` of them."""
    by_topic: dict[str, list[Message]] = {}
    for message in messages:
        if message.kind == "put":
            by_topic.setdefault(registry.topic(message.key), []).append(message)
    found = {}
    for topic, carried in sorted(by_topic.items()):
        samples = []
        for message in carried[:: max(1, len(carried) // _SAMPLES)]:
            kind = registry.type_of_message(message)
            if kind is not None:
                samples.append(TypedPayload(kind, message.payload))
        found[topic] = (len(carried), samples)
    return found


def may_change(
    topic: str,
    path: str,
    leave: Sequence[str],
    include: Sequence[str],
    *,
    kind: MessageType | None = None,
    asked: bool = False,
) -> bool:
    """Return whether a field may be injected.

    If it is `asked`, it must be in `include`, brittle or not.
    """
    if any_names(leave, topic, path):
        return False
    return any_names(include, topic, path) or not (asked or why_brittle(path, kind))


def any_names(patterns: Sequence[str], topic: str, path: str) -> bool:
    """Return whether one of some patterns (`topic:path`) names a field; one that names an array names its length."""
    names = [path, path[4:-1]] if path.startswith("len(") else [path]
    return any(names_field(pattern, f"{topic}:{name}") for pattern in patterns for name in names)


def with_observed(
    targets: Mapping[str, Sequence[Target]], messages: Sequence[Message], registry: TypeRegistry
) -> dict[str, list[Target]]:
    """Return the targets with the values that the log suggests added to those from their definitions."""
    found = {}
    for topic, (_, samples) in samples_by_topic(messages, registry).items():
        if topic in targets:
            rows = [{leaf.path: (leaf.type, leaf.value) for leaf in one.leaves(ELEMENTS)} for one in samples]
            found[topic] = [replace(each, told=(*each.told, *_values(each, rows))) for each in targets[topic]]
    return found


def _values(target: Target, rows: Iterable[Mapping[str, tuple[str, Scalar]]]) -> Iterator[SuggestedValue]:
    own: dict[Scalar, None] = {}
    others: dict[Scalar, None] = {}
    for row in rows:
        if row.get(target.path, ("",))[0] == target.type:
            own[row[target.path][1]] = None
            others |= {value: None for path, (kind, value) in row.items() if kind == target.type and path[:4] != "len("}
    if target.type in ("string", "bytes"):
        texts = [each for each in own if isinstance(each, str | bytes) and len(each) < _LONG and len(own) > 1]
        yield from (SuggestedValue(each, "another message has it") for each in texts[:_OTHERS])
        yield from structured([each for each in own if isinstance(each, str) and len(each) < _LONG])
    elif target.type != "bool" and own:
        numbers = [value for value in own if isinstance(value, int | float) and value - value == 0]
        low, high = min(numbers, default=0), max(numbers, default=0)
        yield from (SuggestedValue(value, "a limit in the log") for value in (low, high) if low < high)
        yield from (SuggestedValue(value, "just beyond what the log has") for value in (low - 1, high + 1))
        between = [number for number in numbers if low < number < high]
        earlier = dict.fromkeys(between[place] for place in (0, len(between) // 2, -1) if between)
        yield from (SuggestedValue(value, "another message has it") for value in earlier)
    strange = [each for each in others if each not in own and (not isinstance(each, str | bytes) or len(each) < _LONG)]
    step = max(1, len(strange) // _OTHERS)
    yield from (SuggestedValue(value, "another field of the message has it") for value in strange[::step][:_OTHERS])
