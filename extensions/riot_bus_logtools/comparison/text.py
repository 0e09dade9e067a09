"""The differences in a topic, as lines of text; pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.log.showing import value_text
from riot_bus.vocabulary.counting import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus_logtools.comparison.parts import FieldDifference, FieldExample, TopicDifference

MOST_FIELDS = 10
"""Most fields of a topic that are shown."""

_MOST_NUMBERS = 8  # as many spans like `#12345-12399` take about 110 characters


def topic_lines(topic: TopicDifference) -> Iterator[str]:
    """Yield the differences in a topic; the first line begins with `!` if they exceed what is tolerated."""
    sign = "=" if topic.same else "!"
    count = f"{topic.count_a}" if topic.count_a == topic.count_b else f"{topic.count_a} -> {topic.count_b}"
    parts = [f"{topic.equal} of {count} equal"]
    parts += [f"{number} {what}" for what, number in facts(topic)]
    yield f"{sign} {topic.topic}  {', '.join(parts)}"
    for name, (a, b) in topic.labels.items():
        yield f"    {name}: {a} -> {b}"
    for one in topic.fields[:MOST_FIELDS]:
        yield f"    {_field(one)}"
    if len(topic.fields) > MOST_FIELDS:
        yield f"    ... {counted(len(topic.fields) - MOST_FIELDS, 'further field')}"
    numbers = (("lost", topic.lost, topic.lost_at), ("added", topic.added, topic.added_at))
    for what, number, places in numbers:
        if number:
            yield f"    {what} {spans(places, number)}"
    if topic.moved:
        yield f"    out of order {moves(topic)}"
    if topic.shifted and topic.allowed:
        yield f"    {topic.allowed:g} may be lost, added or out of order"
    for why, number in topic.opaque.items():
        yield f"    {counted(number, 'message')} compared as bytes: {why}"
    timing = topic.timing
    if timing is not None and timing.late:
        yield f"    {counted(timing.late, 'message')} too early or late, #{timing.number} by {timing.largest:.3f} s"


def facts(topic: TopicDifference) -> list[tuple[str, str]]:
    """Return the kinds of messages that occur besides equal ones, with their numbers."""
    a, b = topic.unaligned
    found = [
        ("within tolerances", str(topic.near)),
        ("changed", str(topic.changed)),
        ("lost", str(topic.lost)),
        ("added", str(topic.added)),
        ("out of order", str(topic.moved)),
        ("not aligned", f"{a} -> {b}" if a or b else "0"),
    ]
    return [(what, number) for what, number in found if number != "0"]


def _field(one: FieldDifference) -> str:
    by = ""
    if one.largest is not None and one.typical is not None:
        by = f", by {one.largest:.6g} at most" + (f" (median {one.typical:.6g})" if one.messages > 1 else "")
    return f"{one.name}  in {counted(one.messages, 'message')}{by}: {_where(one.example, one.name)}"


def _where(example: FieldExample, name: str) -> str:
    number = f"#{example.a}" if example.a == example.b else f"#{example.a} and #{example.b}"
    path = f" {example.path}" if example.path != name else ""
    return f"{number} ({example.seconds:.3f} s){path} {value_text(example.before)} -> {value_text(example.after)}"


def spans(places: Sequence[int], number: int) -> str:
    """Return numbers of messages as text, consecutive ones together: `#3, #7-9`.

    Args:
        places: First of the numbers, increasing.
        number: Number of all messages.
    """
    found: list[list[int]] = []
    for place in places:
        if found and place == found[-1][1] + 1:
            found[-1][1] = place
        else:
            found.append([place, place])
    shown = found[:_MOST_NUMBERS]
    left = number - sum(last - first + 1 for first, last in shown)
    text = ", ".join(f"#{first}" if first == last else f"#{first}-{last}" for first, last in shown)
    return f"{text} and {left} more" if left else text


def moves(topic: TopicDifference) -> str:
    """Return which messages are in another order."""
    shown = topic.moved_at[:_MOST_NUMBERS]
    text = ", ".join(f"#{one} as #{other}" for one, other in shown)
    left = topic.moved - len(shown)
    return f"{text} and {left} more" if left else text


def rest_lines(topics: Sequence[TopicDifference]) -> Iterator[str]:
    """Yield the lines about all topics together: fields that were not compared, same fields, and timing."""
    left = [f"{topic.topic}:{name} ({number})" for topic in topics for name, number in topic.left.items()]
    if left:
        more = f" and {len(left) - _MOST_NUMBERS} more" if len(left) > _MOST_NUMBERS else ""
        yield f"not compared, in so many messages different: {', '.join(left[:_MOST_NUMBERS])}{more}"
    other = sum(topic.same_fields for topic in topics)
    if other:
        yield f"{counted(other, 'message')} with other bytes, but the same fields"
    timed = [(topic.timing.largest, topic.timing.median, topic.topic) for topic in topics if topic.timing is not None]
    if timed:
        largest, median, name = max(timed)
        yield f"timing: {name} differs most, by {largest:.3f} s (median {median:.3f} s)"
