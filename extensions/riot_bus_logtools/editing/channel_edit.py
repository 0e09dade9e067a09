"""Selects and changes the messages of one channel."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.log import layout
from riot_bus.log.engine.blocks import NUMBERS
from riot_bus.log.engine.mcap_file import record_bytes
from riot_bus.log.naming import means
from riot_bus.log.reader import ChannelSource, channel_source
from riot_bus.types.capabilities import PublishesAs
from riot_bus.vocabulary.errors import ConfigError, PayloadError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mcap.records import Channel, Schema

    from riot_bus.log.reader import ChannelSource
    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus.types.model import Adapter, MessageType
    from riot_bus_logtools.editing.assignment import Assignment
    from riot_bus_logtools.editing.result import EditCounts
    from riot_bus_logtools.editing.selection import Condition, Selection

_NO_KEY = re.compile(r"\A\Z|//|[*$?#\s]")


@dataclass(frozen=True, slots=True, eq=False)
class OutputChannel:
    """A channel of the output."""

    channel: Channel
    schema: Schema | None
    source: ChannelSource

    @property
    def name(self) -> str:
        """Name of its topic shown to users."""
        return self.source.topic

    def definition(self) -> bytes:
        """Return the records that define the channel."""
        schema = record_bytes(self.schema) if self.schema is not None else b""
        return schema + record_bytes(self.channel)


class Targets:
    """Assigns numbers to channels and schemas, the same as in the input if these are free."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str, frozenset[tuple[str, str]], int], OutputChannel] = {}
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channel_numbers: set[int] = set()
        self._schema_numbers: set[int] = {0}

    def open(self, channel: Channel, schema: Schema | None) -> OutputChannel:
        """Return a channel of the output; the same one for equal definitions."""
        own_schema = schema
        if schema is not None:
            definition = schema.name, schema.encoding, schema.data
            if definition not in self._schemas:
                self._schemas[definition] = replace(schema, id=_free(schema.id, self._schema_numbers))
            own_schema = self._schemas[definition]
        number = 0 if own_schema is None else own_schema.id
        identity = channel.topic, channel.message_encoding, frozenset(channel.metadata.items()), number
        found = self._known.get(identity)
        if found is None:
            record = replace(channel, id=_free(channel.id, self._channel_numbers), schema_id=number)
            found = self._known[identity] = OutputChannel(record, own_schema, channel_source(record, own_schema))
        return found


def new_identity(channel: Channel, topic: RecordedTopic, name: str, adapters: Sequence[Adapter]) -> Channel:
    """Return a channel under another name; raises ConfigError if no topic can have it."""
    if not topic.keyed:
        new = name if name.startswith("/") or not topic.name.startswith("/") else f"/{name}"
        return replace(channel, topic=new)
    key = _new_key(topic, name, adapters)
    shown = next((found.name for each in adapters if (found := each.topic(key)) is not None), key)
    metadata = {**channel.metadata, layout.KEY: key, layout.TOPIC: shown}
    original = metadata.get(layout.ROLE) == "original"
    return replace(channel, topic=layout.ORIGINAL_PREFIX + shown.lstrip("/") if original else shown, metadata=metadata)


def _new_key(topic: RecordedTopic, name: str, adapters: Sequence[Adapter]) -> str:
    for adapter in adapters:
        offer = adapter.offer(topic, name=name, domain=None) if isinstance(adapter, PublishesAs) else None
        if offer is not None:
            return offer.key
    key = name.strip("/")
    if _NO_KEY.search(key):
        raise ConfigError(
            f"{name!r} cannot be the name of a topic", where="--remap", hint="give it one without wildcards"
        )
    return key


def _free(wish: int, taken: set[int]) -> int:
    number = wish
    if number in taken or not 0 <= number < NUMBERS:
        number = next((each for each in range(1, NUMBERS) if each not in taken), -1)
        if number < 0:
            raise ConfigError(f"more than {NUMBERS - 1} channels do not fit into one log", hint="merge fewer logs")
    taken.add(number)
    return number


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
        if self.failed >= 1000:  # a misspelt field ends an edit early; a guess
            self.check()

    def check(self) -> None:
        """Raise ConfigError if it has failed for all messages."""
        if self.problem is not None and not self.succeeded:
            where = f"{self.name}: {self.problem.where}" if self.problem.where else self.name
            raise ConfigError(self.problem.message, where=where, hint=self.problem.hint)


class EditStep:
    """One `--keep`, `--drop` or `--set`, and its success in reading the fields of its predicate and setting its own."""

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
        topic: Topic as it was recorded; `source` has the messages' common properties.
        target: Channel that they are written to; None if all are dropped.
        channel: Number of the channel in its input, -1 if it has none.
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
                action = self._actions.get(place)
                if action is None:
                    kind = self.kind(payload)
                    action = assignment.shortcut(kind, payload) or partial(assignment.applied, kind)
                    self._actions[place] = action
                payload = action(payload)
            except PayloadError as error:
                step.setting.fail(error)
            else:
                step.setting.succeeded += 1
        return payload


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
