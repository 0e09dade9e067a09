"""Makes a `ChannelEdit` for each channel of the inputs, when the channel becomes known."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from mcap.records import Channel
from mcap.records import Schema as SchemaRecord

from riot_bus.log import layout
from riot_bus.log.layout import Constants
from riot_bus.log.naming import in_full, means, renamed
from riot_bus.log.reader import channel_source
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean
from riot_bus_logtools.editing.channel_edit import (
    ChannelEdit,
    EditStep,
    OutputChannel,
    Targets,
    concerning,
    new_identity,
)
from riot_bus_logtools.editing.result import EditCounts

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus.types.model import Adapter, MessageType
    from riot_bus.vocabulary.message import Message
    from riot_bus_logtools.editing.inputs import InputLog
    from riot_bus_logtools.editing.options import Design, EditOptions
    from riot_bus_logtools.editing.selection import Selection


class ChannelTable:
    """Finds out what happens to each channel of the inputs: `edits`, by numbers of their own.

    Raises ConfigError if an option names a topic that the logs do not have, or a new name is not valid.
    """

    def __init__(
        self, options: EditOptions, design: Design, inputs: Sequence[InputLog], origin: Callable[[], int]
    ) -> None:
        self.edits: list[ChannelEdit] = []
        self._options = options
        self._design = design = self._in_full(design, inputs)
        self._origin = origin
        self._keep = [EditStep(each) for each in design.keep]
        self._drop = [EditStep(each) for each in design.drop]
        self._changes = [EditStep(each.selection, each) for each in design.changes]
        self.steps = [*self._keep, *self._drop, *self._changes]
        self._targets = Targets()
        self._counts: dict[str, EditCounts] = {}
        self._numbers: dict[str, list[int]] = {}
        self._by_key: dict[str, int] = {}
        self._definitions: list[tuple[Channel, SchemaRecord | None]] = []
        self._by_channel: dict[tuple[int, int], int] = {}
        for log in inputs:
            for number in log.channel_records:
                self.edit_of(log, number)
        self._check()

    @cached_property
    def adapters(self) -> list[Adapter]:
        """All installed adapters; they know the definitions that the user named."""
        found = load_adapters()
        TypeRegistry(found, definitions=self._options.definitions)
        return found

    @cached_property
    def registry(self) -> TypeRegistry:
        """Registry of topics and types by the keys of the inputs."""
        return self._registry_of([edit.topic for edit in self.edits])

    def _registry_of(self, topics: Sequence[RecordedTopic]) -> TypeRegistry:
        found = TypeRegistry(self.adapters, declared=self._options.types, definitions=self._options.definitions)
        for topic in topics:
            for name in {topic.key, topic.name} if topic.schema.name or topic.encoding else ():
                found.add_schema(name, topic.schema, topic.encoding)
        return found

    def _type_of(self, topic: RecordedTopic, encoding: str, payload: bytes) -> MessageType:
        """Return the type of a channel's messages; raises PayloadError if it is unknown."""
        found = self._registry_of([topic]).type_of(topic.key, payload=payload, encoding=encoding)
        if found is None:
            problem, hint = "the type of these messages is unknown, so its fields are too", "name it: --type TOPIC=TYPE"
            raise PayloadError(problem, where=topic.name, hint=hint)
        return found

    def _in_full(self, design: Design, inputs: Sequence[InputLog]) -> Design:
        """Return the design with short names of topics replaced by keys."""
        topics = [log.recorded_topic(number) for log in inputs for number in log.channel_records]

        def full(text: str) -> str:
            return in_full(text, topics, lambda: self.adapters)

        def select(selection: Selection) -> Selection:
            return replace(selection, topic=full(selection.topic))

        return replace(
            design,
            keep=[*map(select, design.keep)],
            drop=[*map(select, design.drop)],
            changes=[replace(each, selection=select(each.selection)) for each in design.changes],
            shifts=[each if each.topic is None else replace(each, topic=full(each.topic)) for each in design.shifts],
        )

    def pipe(self, is_wanted: Callable[[str], bool]) -> None:
        """Let interceptors see the messages of some keys."""
        for edit in self.edits:
            edit.piped = not edit.original and edit.target is not None and is_wanted(edit.topic.key)

    def counts(self) -> list[EditCounts]:
        """Return the counts of all topics, sorted by name."""
        return sorted(self._counts.values(), key=lambda each: each.topic)

    def targets(self) -> list[OutputChannel]:
        """Return all channels of the output."""
        found = {edit.target.channel.id: edit.target for edit in self.edits if edit.target is not None}
        return [found[number] for number in sorted(found)]

    def target_list(self) -> list[OutputChannel | None]:
        """Return the channels that messages are written to, by number of the channel edit."""
        return [edit.target for edit in self.edits]

    def edit_of(self, log: InputLog, number: int) -> int:
        """Return the number of the edit of an input's channel."""
        known = self._by_channel.get((log.number, number))
        if known is None:
            channel = log.channel_records[number]
            known = self._by_channel[log.number, number] = self._add(channel, log.schema(channel))
        return known

    def edit_of_key(self, message: Message) -> int:
        """Return the number of the edit of a message that an interceptor has made or put on another key."""
        known = self._by_key.get(message.key)
        if known is None or self.edits[known].target is None:  # dropping precedes interceptors
            known = self._by_key[message.key] = self._add(*self._made_channel(message, known), made=True)
        return known

    def _made_channel(self, message: Message, known: int | None) -> tuple[Channel, SchemaRecord | None]:
        if known is not None:
            return self._definitions[known]
        registry = self.registry
        kind = registry.type_of_message(message)
        topic = registry.topic(message.key)
        channel = Channel(
            id=0,
            topic=topic,
            message_encoding=kind.encoding if kind is not None else message.encoding,
            metadata={
                layout.KEY: message.key,
                layout.TOPIC: topic,
                layout.ROLE: "delivered",
                **Constants.of(message).to_metadata(),
            },
            schema_id=0,
        )
        schema = kind.schema if kind is not None else None
        if schema is None:
            return channel, None
        return channel, SchemaRecord(id=1, data=schema.data, encoding=schema.encoding, name=schema.name)

    def _add(self, channel: Channel, schema: SchemaRecord | None, *, made: bool = False) -> int:
        source = channel_source(channel, schema)
        topic, original = source.recorded(channel.metadata), source.role == "original"
        counts = self._counts.setdefault(topic.key, EditCounts(topic.name))
        edit = ChannelEdit(topic, source, None, -1 if made else channel.id, counts, self._type_of)
        edit.numbers = self._numbers.setdefault(topic.key, [0])
        if made or self._select(edit):
            shifts = (each.delta for each in self._design.shifts if each.topic is None or means(each.topic, topic))
            edit.shift = sum(shifts)
            name = renamed(topic, self._design.remaps)
            new = channel if name is None else new_identity(channel, topic, name, self.adapters)
            edit.target = self._targets.open(new, schema)
            counts.written_as = counts.written_as if original else edit.target.name
        self.edits.append(edit)
        self._definitions.append((channel, schema))
        number = len(self.edits) - 1
        if not original:
            self._by_key.setdefault(topic.key, number)
        return number

    def _select(self, edit: ChannelEdit) -> bool:
        """Set which messages of a channel are kept and what is set in them; return whether any may be kept."""
        topic, original = edit.topic, edit.original
        keeping, dropping = concerning(self._keep, topic), concerning(self._drop, topic)
        changing = concerning(self._changes, topic)
        if original:  # originals are only selected by topic and time
            dropping = [step for step in dropping if step.selection.follows_time]
            changing = []
        if original and (not self._options.originals or self._options.folder):
            return False
        if (self._keep and not keeping) or any(step.selection.whole for step in dropping):
            return False
        if keeping and not any(
            each.whole or (original and not each.follows_time) for each in (step.selection for step in keeping)
        ):
            edit.keep = [(step, step.selection.condition(self._origin)) for step in keeping]
        edit.drop = [(step, step.selection.condition(self._origin)) for step in dropping]
        for step in changing:
            assert step.assignment is not None
            condition = step.selection.condition(self._origin)
            edit.changes.append((step, step.assignment, None if condition.always else condition))
        return True

    def _check(self) -> None:
        topics = [edit.topic for edit in self.edits]
        if not topics:
            return
        shifts = [each.topic for each in self._design.shifts if each.topic is not None]
        named = [
            *((step.selection.topic, step.name, step.matched) for step in self.steps),
            *((text, "--shift", any(means(text, topic) for topic in topics)) for text in shifts),
            *((old, "--remap", any(renamed(topic, {old: "x"}) for topic in topics)) for old in self._design.remaps),
        ]
        for text, where, known in named:
            if not known:
                hint = did_you_mean(text, {topic.name for topic in topics})
                raise ConfigError(f"the logs have no topic {text!r}", where=where, hint=hint)
