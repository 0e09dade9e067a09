"""Conformance tests for adapters, for their authors to inherit.

    class TestToys(AdapterConformance):
        adapter = ToyAdapter()
        keys = {"toy/odom/Pose": TopicName("/odom", "Pose")}
        types = ("Pose",)
        capabilities = (ParsesTokens,)
        tokens = ("@toy/node/1",)

Needs pytest and Hypothesis: the extra `testing`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.types.capabilities import (
    Announcement,
    AnnouncesServers,
    ConvertsFiles,
    DiscoversTypes,
    HasServices,
    Identity,
    ListsTypes,
    Offer,
    ParsesTokens,
    PublishesAs,
    ReadsMetadata,
    ReadsTypesFromKeys,
    RecordedTopic,
    SetsParameters,
    Stamp,
    TakesFiles,
)
from riot_bus.types.model import Adapter, MessageType, Schema, TopicName, TypeSource
from riot_bus.types.serve import PARTS
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.selector import key_matches
from riot_bus_testkit.types import SETTINGS, hostile

_OF_ADAPTERS = (
    TakesFiles,
    ListsTypes,
    ReadsTypesFromKeys,
    DiscoversTypes,
    ParsesTokens,
    HasServices,
    AnnouncesServers,
    ReadsMetadata,
    PublishesAs,
    SetsParameters,
    ConvertsFiles,
)
_EMPTY = Schema("", "", b"")


class AdapterConformance:
    """Tests of an adapter: names and types survive a round trip, and nothing on the bus makes it raise.

    Attributes:
        adapter: The adapter under test.
        keys: Some of its keys, and what `topic` returns for them before any message was received.
        types: Names of some types that it knows.
        capabilities: Protocols of `riot_bus.types.capabilities` that it is meant to implement.
        foreign: Keys and names that do not belong to it; empty for an adapter that accepts all.
        tokens: Liveliness tokens that it can read, if it implements `ParsesTokens`.
        archive: Contents of a file in its own format, if it implements `ConvertsFiles`.
    """

    adapter: ClassVar[Adapter]
    keys: ClassVar[Mapping[str, TopicName]]
    types: ClassVar[Sequence[str]]
    capabilities: ClassVar[Sequence[type]] = ()
    foreign: ClassVar[Sequence[str]] = ("",)
    tokens: ClassVar[Sequence[str]] = ()
    archive: ClassVar[bytes] = b""

    def test_it_is_an_adapter(self) -> None:
        """The protocol is complete, and the name contains no reserved characters."""
        assert isinstance(self.adapter, TypeSource)
        assert callable(self.adapter.topic)
        assert callable(self.adapter.key_expression)
        assert self.adapter.name
        assert not set(self.adapter.name) & set(":,= \t\n")

    def test_capabilities_that_are_declared_hold(self) -> None:
        """It implements exactly the declared protocols; one implemented by half would be ignored silently."""
        for each in _OF_ADAPTERS:
            methods = {name for name in vars(each) if not name.startswith("_")}
            lacking = sorted(name for name in methods if not callable(getattr(self.adapter, name, None)))
            assert lacking in ([], sorted(methods)), f"{each.__name__} also needs {', '.join(lacking)}"
            assert isinstance(self.adapter, each) == (each in self.capabilities), each.__name__

    def test_keys_have_names(self) -> None:
        """Its keys have the expected names, and foreign keys have none."""
        assert {key: self.adapter.topic(key) for key in self.keys} == dict(self.keys)
        assert [self.adapter.topic(key) for key in self.foreign] == [None] * len(self.foreign)

    def test_names_stand_for_keys(self) -> None:
        """The key expression of a name includes the key; a name without one is its own key expression."""
        for key, topic in self.keys.items():
            assert key_matches(self.adapter.key_expression(topic.name) or topic.name, key)
        assert [self.adapter.key_expression(name) for name in self.foreign] == [None] * len(self.foreign)

    def test_types_have_names(self) -> None:
        """Types are found by name, and again by their own name and schema."""
        for name in self.types:
            found = self.adapter.type_named(name)
            assert isinstance(found, MessageType), name
            again = self.adapter.type_named(found.name)
            assert again is not None
            assert again.name == found.name
            if found.schema is not None:
                logged = self.adapter.type_of_schema(found.schema)
                assert logged is not None
                assert logged.name == found.name

    def test_types_of_keys_are_known(self) -> None:
        """The type that a key names is a type or unknown, never an error."""
        for topic in self.keys.values():
            if topic.type_name is not None:
                assert isinstance(self.adapter.type_named(topic.type_name), MessageType | None)

    @SETTINGS
    @given(data=st.data())
    def test_unknown_names_return_none(self, data: st.DataObject) -> None:
        """No text raises as a name, a key or part of a schema."""
        text = data.draw(_texts([*self.keys, *self.types, *self.foreign]))
        adapter = self.adapter
        assert isinstance(adapter.topic(text), TopicName | None)
        assert isinstance(adapter.key_expression(text), str | None)
        assert isinstance(adapter.type_named(text), MessageType | None)
        known = [found.schema for found in map(adapter.type_named, self.types) if found is not None and found.schema]
        schema = data.draw(st.sampled_from([*known, _EMPTY]))
        for each in (
            Schema(text, schema.encoding, b""),
            Schema(schema.name, text, schema.data),
            Schema(schema.name, schema.encoding, data.draw(hostile([schema.data, text.encode(errors="replace")]))),
        ):
            assert isinstance(adapter.type_of_schema(each), MessageType | None)
        if isinstance(adapter, ReadsTypesFromKeys):
            assert isinstance(adapter.type_of_key(text), MessageType | None)

    def test_a_type_that_does_not_exist(self) -> None:
        """The result is None, so that other adapters are asked."""
        assert self.adapter.type_named("no/such/Type") is None
        assert self.adapter.type_of_schema(Schema("no/such/Type", "no such encoding", b"?")) is None

    def test_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        """A missing file is a ConfigError; an adapter without files of definitions accepts no file."""
        endings = self.adapter.endings if isinstance(self.adapter, TakesFiles) else [".none"]
        assert all(ending.startswith(".") for ending in endings)
        with pytest.raises(ConfigError):
            self.adapter.load([tmp_path / f"missing{endings[0]}"])

    def test_listed_types_are_known(self) -> None:
        """Listed types are found by name."""
        for name in islice(self._able(ListsTypes).type_names(), 100):
            assert isinstance(self.adapter.type_named(name), MessageType), name

    def test_tokens_are_read(self) -> None:
        """The sample tokens are announcements, and the adapter subscribes to tokens like these."""
        adapter = self._able(ParsesTokens)
        assert self.tokens
        for token in self.tokens:
            assert isinstance(adapter.announcement(token), Announcement), token
            assert any(key_matches(expression, token) for expression in adapter.announcements), token

    @SETTINGS
    @given(data=st.data())
    def test_hostile_tokens(self, data: st.DataObject) -> None:
        """Arbitrary tokens are read or ignored."""
        adapter = self._able(ParsesTokens)
        token = data.draw(_texts(self.tokens))
        assert isinstance(adapter.announcement(token), Announcement | None)
        if isinstance(adapter, ReadsMetadata):
            key = data.draw(st.sampled_from(list(self.keys)))
            told = adapter.details(key, [token, *self.tokens])
            assert all(isinstance(each, str) for pair in told.items() for each in pair)

    @SETTINGS
    @given(data=st.data())
    def test_hostile_attachments(self, data: st.DataObject) -> None:
        """Arbitrary attachments are read or ignored; arbitrary keys have a definition or None."""
        adapter = self._able(ReadsMetadata)
        assert isinstance(adapter.stamp(data.draw(st.binary(max_size=80))), Stamp | None)
        found = adapter.definition(data.draw(_texts(list(self.keys))))
        assert found is None or (isinstance(found[0], Schema) and isinstance(found[1], str))

    @SETTINGS
    @given(data=st.data())
    def test_any_service(self, data: st.DataObject) -> None:
        """Services and actions may have any name."""
        adapter = self._able(HasServices)
        name = data.draw(_texts([*self.types, *(topic.name for topic in self.keys.values())]))
        assert isinstance(adapter.action_parts(name), str | None)
        assert all(isinstance(adapter.call_type(name, part), str | None) for part in (*PARTS, name))

    @SETTINGS
    @given(data=st.data())
    def test_answers_of_strangers(self, data: st.DataObject) -> None:
        """Any answer to a query for a type is survived."""
        adapter = self._able(DiscoversTypes)
        key = data.draw(_texts(list(self.keys)))
        answers = data.draw(st.lists(st.binary(max_size=80), max_size=3))
        if adapter.missing(key):
            tokens = [*self.tokens, data.draw(_texts(self.tokens))]
            assert adapter.learn(key, tokens, answers, lambda *_: answers) is None

    def test_servers_are_announced_as_others_are(self) -> None:
        """The adapter reads its own token of a server as one of the same key; a topic has no server."""
        adapter = self._able(AnnouncesServers)
        parser = self._able(ParsesTokens)
        parsed = map(parser.announcement, self.tokens)
        found = [one for one in parsed if one is not None and one.role == "serves" and not one.action]
        assert found, "`tokens` lacks that of a server"
        for one in found:
            again = [parser.announcement(token) for token in adapter.server_tokens(one.key, "3f2a", 1)]
            assert [(each.key, each.type_name) for each in again if each and each.role == "serves"] == [
                (one.key, one.type_name)
            ]
        assert all(adapter.server_tokens(key, "3f2a", 1) == () for key in [*self.keys, *self.foreign])

    def test_topics_are_published_again(self) -> None:
        """A recorded topic keeps its name, and the adapter can read the identity of its own publisher."""
        adapter = self._able(PublishesAs)
        for key, topic in self.keys.items():
            kind = self.adapter.type_named(topic.type_name) if topic.type_name else None
            schema = kind.schema if kind is not None and kind.schema is not None else _EMPTY
            encoding = "" if kind is None else kind.encoding
            recorded = RecordedTopic(topic.name, key, keyed=True, schema=schema, encoding=encoding)
            offer = adapter.offer(recorded, name=None, domain=None)
            if offer is not None:
                found = self.adapter.topic(offer.key)
                assert found is not None
                assert found.name == topic.name
                self._check_identity(offer)

    def test_topics_of_others_are_left_to_others(self) -> None:
        """The adapter makes no offer for a foreign topic."""
        schema = Schema("x", "no such encoding", b"")
        topic = RecordedTopic("no such", "no such", keyed=True, schema=schema, encoding="no such encoding")
        assert self._able(PublishesAs).offer(topic, name=None, domain=None) is None

    def test_the_clock_is_told(self) -> None:
        """The clock, if there is one, encodes a time as bytes."""
        clock = self._able(PublishesAs).clock([], domain=None)
        if clock is not None:
            assert isinstance(clock.payload(1_500_000_000), bytes)
            self._check_identity(clock.offer)

    def test_files_are_converted(self) -> None:
        """The messages of the sample are unchanged after being packed and unpacked."""
        adapter = self._able(ConvertsFiles)
        assert all(ending.startswith(".") for ending in adapter.archives)
        messages = self._unpacked(self.archive)
        assert messages
        records = [adapter.packed(message) for message in messages]
        again = self._unpacked(b"".join(record for record in records if record is not None))
        assert [(each.key, each.payload) for each in again] == [(each.key, each.payload) for each in messages]
        assert adapter.packed(Message(0, "no such key", b"?")) is None

    @SETTINGS
    @given(data=st.data())
    def test_hostile_files(self, data: st.DataObject) -> None:
        """Arbitrary files are read as far as possible."""
        self._able(ConvertsFiles)
        self._unpacked(data.draw(hostile([self.archive])))

    def _unpacked(self, data: bytes) -> list[Message]:
        unpacker = self._able(ConvertsFiles).unpacker()
        half = len(data) // 2
        messages = [*unpacker.feed(data[:half]), *unpacker.feed(data[half:]), *unpacker.end()]
        assert isinstance(unpacker.loss(), str)
        return messages

    def _check_identity(self, offer: Offer) -> None:
        identity = Identity() if offer.identify is None else offer.identify("3f2a", 1)
        if identity.tokens and isinstance(self.adapter, ParsesTokens):
            assert any(self.adapter.announcement(token) is not None for token in identity.tokens)
        attachment = None if identity.attachment is None else identity.attachment(None, 7, 1_500_000_000)
        if attachment is not None and isinstance(self.adapter, ReadsMetadata):
            stamp = self.adapter.stamp(attachment)
            assert stamp is None or stamp.sequence == 7

    def _able(self, capability: Any) -> Any:
        """Return the adapter; skip the test if the capability is not declared."""
        if capability not in self.capabilities:
            pytest.skip(f"this adapter has no {capability.__name__}")
        assert isinstance(self.adapter, capability)
        return self.adapter


@st.composite
def _texts(draw: st.DrawFn, samples: Sequence[str]) -> str:
    """Return any text, or a sample with a part replaced."""
    if not samples or draw(st.integers(0, 4)) == 0:
        return draw(st.text(max_size=40))
    sample = draw(st.sampled_from(samples))
    start = draw(st.integers(0, len(sample)))
    end = draw(st.integers(start, len(sample)))
    return sample[:start] + draw(st.text(max_size=8) | st.sampled_from(["/", "*", "**", "%", ":", "@"])) + sample[end:]
