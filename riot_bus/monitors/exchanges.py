"""Invariants on what is said, in what order, and whether it is answered: never, values, sequence, answered."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import Selector, parse_selector
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.types.model import MessageType
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["Answered", "Gapless", "Never", "Values"]


class Never:
    """No message meets a condition.

    Args:
        when: A selector with a predicate, `1/1/STATUSTEXT where severity <= 2`; without one no message may come at all.
        tell: A field of such a message that is told.

    Raises:
        ConfigError: It is no such selector.
    """

    def __init__(self, when: str, *, tell: str | None = None) -> None:
        self.when, self.tell = when, tell
        self._selector = _whole(when)
        self.topics: tuple[str, ...] = (self._selector.topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first such message."""
        for message, kind in _selected(view, self._selector):
            told = "" if self.tell is None else f": {self.tell} = {kind.read(message.payload, self.tell)!r}"
            return [Violation("never", self.topics[0], f"never {self.when}", f"{message.key}{told}")]
        return []


class Values:
    """An integer field takes only some values.

    Args:
        field: `topic:field`.
        allowed: The values.
        mask: Bits of the field that count; None for all.
    """

    def __init__(self, field: str, *, allowed: Sequence[int], mask: int | None = None) -> None:
        self.field, self.allowed, self.mask = field, frozenset(allowed), mask
        self._selector = _with_field(field)
        self.topics: tuple[str, ...] = (self._selector.topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first other value."""
        for message, kind in _selected(view, self._selector):
            value = kind.read(message.payload, self._selector.field or "")
            if not isinstance(value, int):
                raise PayloadError(f"{self.field} is no integer, so its values cannot be watched")
            seen = value if self.mask is None else value & self.mask
            if seen not in self.allowed:
                known = ", ".join(map(str, sorted(self.allowed)))
                detail = f"{self.field} = {value}, allowed: {known}" + (f" of bits {self.mask:#x}" if self.mask else "")
                return [Violation("values", self.field, f"values of {self.field}", detail)]
        return []


class Gapless:
    """A sequence number grows by one from message to message, so that none is lost; it begins anew at `modulo`.

    Args:
        field: `topic:field`; a topic with wildcards is one stream.
        modulo: The number after the last one is 0.
        lost: So many may be missing.
    """

    def __init__(self, field: str, *, modulo: int = 256, lost: int = 0) -> None:
        self.field, self.modulo, self.lost = field, modulo, lost
        self._selector = _with_field(field)
        self.topics: tuple[str, ...] = (self._selector.topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when too many are missing."""
        missing, received, last = 0, 0, None
        for message, kind in _selected(view, self._selector):
            value = kind.read(message.payload, self._selector.field or "")
            if not isinstance(value, int):
                raise PayloadError(f"{self.field} is no integer, so it is no sequence number")
            missing += 0 if last is None else (value - last - 1) % self.modulo
            received, last = received + 1, value
        if missing <= self.lost:
            return []
        detail = f"{missing} lost, {received} received (allowed: {self.lost})"
        return [Violation("sequence", self.field, f"sequence of {self.field}", detail)]


class Answered:
    """Each request gets an answer in time.

    Args:
        request: A selector, such as `255/*/COMMAND_LONG`.
        answer: A selector of answers, such as `1/1/COMMAND_ACK where result == 0`.
        within: Seconds of wall time.
        same: Fields whose values are equal in a request and its answer.

    Raises:
        ConfigError: These are no selectors of messages.
    """

    def __init__(self, request: str, *, answer: str, within: float, same: Sequence[str] = ()) -> None:
        self.request, self.answer, self.within, self.same = request, answer, within, tuple(same)
        self._asks, self._answers = _whole(request), _whole(answer)
        self.topics: tuple[str, ...] = (self._asks.topic, self._answers.topic)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first request without an answer; those that may still get one are left out."""
        answers = [(message.time, self._values(message, kind)) for message, kind in _selected(view, self._answers)]
        period = round(self.within * 1e9)
        for message, kind in _selected(view, self._asks):
            end, values = message.time + period, self._values(message, kind)
            if end <= view.end and not any(message.time <= time <= end and each == values for time, each in answers):
                shown = ", ".join(f"{name} = {value!r}" for name, value in zip(self.same, values, strict=True))
                detail = f"no answer within {self.within:g} s" + (f" to {shown}" if shown else "")
                return [Violation("answered", self.request, f"answer to {self.request}", detail)]
        return []

    def _values(self, message: Message, kind: MessageType) -> tuple[Scalar, ...]:
        return tuple(kind.read(message.payload, name) for name in self.same)


def _whole(text: str) -> Selector:
    selector = parse_selector(text)
    if selector.field is not None:
        hint = "write it like '1/1/STATUSTEXT where severity <= 2'"
        raise ConfigError(f"{text!r} selects a field instead of messages", where="[[monitors]]", hint=hint)
    if selector.where is not None:
        parse_predicate(selector.where)
    return selector


def _with_field(text: str) -> Selector:
    selector = parse_selector(text)
    if selector.field is None:
        raise ConfigError(f"{text!r} names no field", where="[[monitors]]", hint="write it like 'topic:field'")
    return selector


def _selected(view: TrialView, selector: Selector) -> Iterator[tuple[Message, MessageType]]:
    predicate = None if selector.where is None else parse_predicate(selector.where)
    for message in view.outputs:
        if message.kind != "put" or not view.registry.matches(selector.topic, message.key):
            continue
        kind = view.registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
        if kind is None:
            raise PayloadError(f"the type of {message.key!r} is unknown, so {selector.topic!r} cannot be watched")
        if predicate is None or predicate(partial(kind.read, message.payload)):
            yield message, kind
