"""Selects and changes the messages of one channel."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.log.naming import means
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_logtools.editing.targets import OutputChannel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.log.reader import ChannelSource
    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus.types.model import MessageType
    from riot_bus_logtools.editing.assignment import Assignment
    from riot_bus_logtools.editing.result import EditCounts
    from riot_bus_logtools.editing.selection import Condition, Selection

_HOPELESS = 1000  # failures without a success: a misspelt field ends an edit early; a guess


class Trouble:
    """How often an action on messages succeeded, and how often it failed."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.succeeded = self.failed = 0
        self.problem: PayloadError | None = None
        """The first failure."""

    def fail(self, error: PayloadError) -> None:
        """Count a failure; raises ConfigError after many failures without a success."""
        self.failed += 1
        if self.problem is None:
            self.problem = error
        if self.failed >= _HOPELESS:
            self.check()

    def check(self) -> None:
        """Raise ConfigError if it has failed for all messages."""
        if self.problem is not None and not self.succeeded:
            where = f"{self.name}: {self.problem.where}" if self.problem.where else self.name
            raise ConfigError(self.problem.message, where=where, hint=self.problem.hint)


class EditStep:
    """One `--keep`, `--drop` or `--set`, and its success.

    Attributes:
        matched: Whether there is such a topic.
        reading: Success of reading the fields of its predicate.
        setting: Success of setting its field.
    """

    def __init__(self, selection: Selection, assignment: Assignment | None = None) -> None:
        self.selection = selection
        self.assignment = assignment
        self.matched = False
        self.name = f"{selection.option} {selection.text!r}"
        self.reading = Trouble(self.name)
        self.setting = Trouble(self.name)

    def warnings(self) -> list[str]:
        """Return the warnings about it at the end; raises ConfigError if it has failed for all messages."""
        found = []
        for trouble, text in ((self.reading, "not selected"), (self.setting, "left as they are")):
            trouble.check()
            if trouble.failed:
                found.append(f"{self.name}: {trouble.failed} messages are {text}; the first one: {trouble.problem}")
        return found


@dataclass(slots=True, eq=False)
class ChannelEdit:
    """What happens to the messages of one channel.

    Attributes:
        topic: Topic as it was recorded.
        source: Common properties of the messages as they were recorded.
        target: Channel that they are written to; None if all are dropped.
        channel: Number of the channel in its input, -1 if it has none.
        counts: Counts of the topic.
        find_type: Function that returns the type of a topic, given the encoding and payload of a message.
        shift: Nanoseconds that are added to their times.
        keep: Conditions of which one must be met; None if all are kept.
        drop: Conditions of which none may be met.
        changes: Assignments with their conditions, None for an unconditional one.
        piped: Whether interceptors see them.
        numbers: Number of earlier messages of the topic, in a list with one element.
    """

    topic: RecordedTopic
    source: ChannelSource
    target: OutputChannel | None
    channel: int
    counts: EditCounts
    find_type: Callable[[RecordedTopic, str, bytes], MessageType]
    shift: int = 0
    keep: list[tuple[EditStep, Condition]] | None = None
    drop: list[tuple[EditStep, Condition]] = field(default_factory=list)
    changes: list[tuple[EditStep, Assignment, Condition | None]] = field(default_factory=list)
    piped: bool = False
    numbers: list[int] = field(default_factory=lambda: [0])
    _kind: MessageType | None = None
    _actions: dict[int, Callable[[bytes], bytes]] = field(default_factory=dict)

    @property
    def original(self) -> bool:
        """Whether it holds originals."""
        return self.source.role == "original"

    @property
    def choosy(self) -> bool:
        """Whether messages have to be looked at one by one, before interceptors see them."""
        return self.target is not None and (self.chooses or bool(self.changes))

    @property
    def chooses(self) -> bool:
        """Whether not all of them are kept."""
        return self.keep is not None or bool(self.drop)

    def kind(self, payload: bytes) -> MessageType:
        """Return the type of the messages; raises PayloadError if it is unknown."""
        if self._kind is None:
            encoding = self.target.source.constants.encoding if self.target is not None else ""
            self._kind = self.find_type(self.topic, encoding or self.topic.encoding, payload)
        return self._kind

    def chosen(self, time: int, number: int, payload: bytes) -> bool:
        """Return whether a message is kept."""
        if self.keep is not None and not any(_holds(self, *each, time, number, payload) for each in self.keep):
            return False
        return not any(_holds(self, *each, time, number, payload) for each in self.drop)

    def changed(self, time: int, number: int, payload: bytes) -> bytes:
        """Return the payload with fields set; the same object if nothing is to be done."""
        for place, (step, assignment, condition) in enumerate(self.changes):
            if condition is not None and not _holds(self, step, condition, time, number, payload):
                continue
            try:
                action = self._actions.get(place) or self._action(place, assignment, payload)
                payload = action(payload)
            except PayloadError as error:
                step.setting.fail(error)
            else:
                step.setting.succeeded += 1
        return payload

    def _action(self, place: int, assignment: Assignment, payload: bytes) -> Callable[[bytes], bytes]:
        kind = self.kind(payload)
        found = assignment.shortcut(kind, payload) or partial(assignment.applied, kind)
        self._actions[place] = found
        return found


def concerning(steps: Sequence[EditStep], topic: RecordedTopic) -> list[EditStep]:
    """Return the steps that apply to a topic, and mark them as matched."""
    found = [step for step in steps if means(step.selection.topic, topic)]
    for step in found:
        step.matched = True
    return found


def _holds(edit: ChannelEdit, step: EditStep, condition: Condition, time: int, number: int, payload: bytes) -> bool:
    if condition.where is None:
        return condition.holds(time, number)
    try:
        found = condition.holds(time, number, lambda path: edit.kind(payload).read(payload, path))
    except PayloadError as error:
        step.reading.fail(error)
        return False
    step.reading.succeeded += 1
    return found
