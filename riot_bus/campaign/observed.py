"""Values that the nominal log suggests: limits, values just beyond them, and values of other fields."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.campaign.targets import samples_by_topic
from riot_bus.types.capabilities import SuggestedValue
from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.campaign.targets import Target
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["with_observed"]

_SAMPLES = 200
"""Messages of a topic that are read: enough for limits, and a second at most for large messages."""
_WORDS = _OTHERS = 4
"""Number of texts of the field itself, and of values of other fields of its message, that are tried."""
_LONG = 4096
"""Texts of this length or longer are not tried elsewhere: each test case would hold them."""


def with_observed(
    targets: Mapping[str, Sequence[Target]], messages: Sequence[Message], registry: TypeRegistry
) -> dict[str, list[Target]]:
    """Return the targets with the values that the log suggests added to those from their definitions.

    Args:
        targets: Targets by topic, from `targets_of`.
        messages: The nominal log.
        registry: Registry of the log's types.
    """
    found = {}
    for topic, (_, samples) in samples_by_topic(messages, registry, most=_SAMPLES).items():
        rows: list[dict[str, tuple[str, Scalar]]] = []
        for kind, payload in samples if topic in targets else ():
            try:
                rows.append({leaf.path: (leaf.type, leaf.value) for leaf in kind.leaves(payload, elements=4)})
            except PayloadError:
                continue
        if topic in targets:
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
        yield from (SuggestedValue(each, "another message has it") for each in texts[:_WORDS])
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
