"""Selection of the outputs of a trial that monitors judge, and of numbers in their fields."""

from __future__ import annotations

from collections.abc import Callable  # not for types alone: options of monitors are checked by their annotations
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from riot_bus.monitors.model import why_no_message
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import Selector, parse_selector

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.types.model import MessageType
    from riot_bus.vocabulary.message import Message


class WithSelectors:
    """Base class of monitors some of whose attributes are selectors.

    Attributes:
        selectors: Names of these attributes, each with the function that parses it; in the order of `topics`.
    """

    selectors: ClassVar[tuple[tuple[str, Callable[[str], Selector]], ...]]

    def __post_init__(self) -> None:
        _ = self.topics  # raises ConfigError

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics whose messages it looks at."""
        return tuple(parse(getattr(self, name)).topic for name, parse in self.selectors)


def message_selector(text: str) -> Selector:
    """Return a selector of whole messages; raises ConfigError if the text is not one."""
    selector = parse_selector(text)
    if selector.field is not None:
        hint = f"write '{selector.topic} where {selector.field} <= 2', say, or only {selector.topic!r}"
        raise ConfigError(f"{text!r} selects a field instead of messages", hint=hint)
    if selector.where is not None:
        parse_predicate(selector.where)
    return selector


def field_selector(text: str) -> Selector:
    """Return a selector of a field; raises ConfigError if the text is not one."""
    selector = parse_selector(text)
    if selector.field is None:
        raise ConfigError(f"{text!r} does not name a field", hint="write it like 'topic:field'")
    return selector


def selected(
    view: TrialView, selector: Selector, messages: Sequence[Message] | None = None
) -> Iterator[tuple[Message, MessageType]]:
    """Yield the selected messages with their types, from the outputs of a trial or from the given messages.

    Raises:
        PayloadError: The type of a message is unknown.
    """
    predicate = None if selector.where is None else parse_predicate(selector.where)
    for message in view.outputs if messages is None else messages:
        if message.kind != "put" or not view.registry.matches(selector.topic, message.key):
            continue
        kind = view.registry.type_of_message(message)
        if kind is None:
            raise PayloadError(f"the type of {message.key!r} is unknown, so {selector.topic!r} cannot be watched")
        if predicate is None or predicate(partial(kind.read, message.payload)):
            yield message, kind


def numbers(view: TrialView, selector: Selector) -> Iterator[float]:
    """Yield the selected field of the selected outputs, where it is a number or a boolean."""
    for message, kind in selected(view, selector):
        value = kind.read(message.payload, selector.field or "")
        if isinstance(value, bool | int | float):
            yield float(value)


def integers(view: TrialView, selector: Selector) -> Iterator[int]:
    """Yield the selected field of the selected outputs; raises PayloadError where it is not an integer."""
    for message, kind in selected(view, selector):
        value = kind.read(message.payload, selector.field or "")
        if not isinstance(value, int):
            raise PayloadError(f"{selector.topic}:{selector.field} is not an integer")
        yield value


def why_unseen(view: TrialView, selector: Selector, *, met: bool = True) -> str | None:
    """Return why no output has what is selected: a message, a number in the field; None if one has.

    If its condition need not be `met`, its fields only have to exist.

    Raises:
        PayloadError: The type of an output of the topic is unknown.
    """
    absent = why_no_message(view, selector.topic)
    if absent is not None:
        return absent
    predicate = None if selector.where is None else parse_predicate(selector.where)
    count, why = 0, f"none meets {selector.where!r}"
    for message, kind in selected(view, Selector(selector.topic)):
        count += 1
        read = partial(kind.read, message.payload)
        try:
            if predicate is not None and not predicate(read) and met:
                continue
            if selector.field is None or isinstance(read(selector.field), bool | int | float):
                return None
            why = f"{selector.field!r} is not a number"
        except PayloadError as error:
            why = "; ".join(filter(None, (error.message, error.hint)))
    return f"of {count} messages of {selector.topic!r}: {why}"
