"""What every adapter has to hold, as tests to inherit: for authors of adapters.

    class TestToys(AdapterConformance):
        adapter = ToyAdapter()
        keys = {"toy/odom/Pose": TopicName("/odom", "Pose")}
        types = ("Pose",)
        capabilities = (ParsesTokens,)
        tokens = ("@toy/node/1",)

Needs pytest and Hypothesis: pip install 'riot-bus[testing]'.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.testing.types import SETTINGS, hostile
from riot_bus.types.capabilities import (
    Announcement,
    AnnouncesServers,
    ConvertsFiles,
    DiscoversTypes,
    HasServices,
    Identity,
    ListensToLinks,
    ListsTypes,
    Offer,
    ParsesTokens,
    PublishesAs,
    ReadsMetadata,
    ReadsTypesFromKeys,
    RecordedTopic,
    Stamp,
    TakesFiles,
)
from riot_bus.types.model import MessageType, Schema, TopicName, TypeSource
from riot_bus.types.serve import PARTS
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.selector import key_matches

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.types.model import Adapter

__all__ = ["AdapterConformance"]

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
    ConvertsFiles,
    ListensToLinks,
)
_LISTED = 100  # so many names of types are looked up
_EMPTY = Schema("", "", b"")


class AdapterConformance:
    """What holds for an adapter: names and types are found again, and nothing on the bus makes it raise.

    Attributes:
        adapter: The adapter.
        keys: Some of its keys, and what `topic` returns for them before anything was heard.
        types: Names of some types that it knows.
        capabilities: The protocols of `riot_bus.types.capabilities` that it is meant to have.
        foreign: Keys and names that are not of its kind; none for an adapter that takes all.
        tokens: Liveliness tokens that it can read, where it has `ParsesTokens`.
        archive: A file in a format of its own, where it has `ConvertsFiles`.
    """

    adapter: ClassVar[Adapter]
    keys: ClassVar[Mapping[str, TopicName]]
    types: ClassVar[Sequence[str]]
    capabilities: ClassVar[Sequence[type]] = ()
    foreign: ClassVar[Sequence[str]] = ("",)
    tokens: ClassVar[Sequence[str]] = ()
    archive: ClassVar[bytes] = b""

    def test_it_is_an_adapter(self) -> None:
        """The protocol is complete, and a user can write the name."""
        assert isinstance(self.adapter, TypeSource)
        assert callable(self.adapter.topic)
        assert callable(self.adapter.key_expression)
        assert self.adapter.name
        assert not set(self.adapter.name) & set(":,= \t\n")

    def test_capabilities_that_are_declared_hold(self) -> None:
        """It has what it is meant to have, no more; a protocol that it has by half would be ignored without a word."""
        for each in _OF_ADAPTERS:
            methods = {name for name in vars(each) if not name.startswith("_")}
            lacking = sorted(name for name in methods if not callable(getattr(self.adapter, name, None)))
            assert lacking in ([], sorted(methods)), f"{each.__name__} also needs {', '.join(lacking)}"
            assert isinstance(self.adapter, each) == (each in self.capabilities), each.__name__

    def test_keys_have_names(self) -> None:
        """Keys are called as they should, and no others are."""
        assert {key: self.adapter.topic(key) for key in self.keys} == dict(self.keys)
        assert [self.adapter.topic(key) for key in self.foreign] == [None] * len(self.foreign)

    def test_names_stand_for_keys(self) -> None:
        """An expression for a name includes the key; a name for which there is none is its own expression."""
        for key, topic in self.keys.items():
            assert key_matches(self.adapter.key_expression(topic.name) or topic.name, key)
        assert [self.adapter.key_expression(name) for name in self.foreign] == [None] * len(self.foreign)

    def test_types_have_names(self) -> None:
        """Types are found by name, and again by the name and the schema that they say themselves."""
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
        """What a key names as its type is a type, or not known; never an error."""
        for topic in self.keys.values():
            if topic.type_name is not None:
                assert isinstance(self.adapter.type_named(topic.type_name), MessageType | None)

    @SETTINGS
    @given(data=st.data())
    def test_unknown_names_return_none(self, data: st.DataObject) -> None:
        """No name, key or schema raises, whatever somebody calls it."""
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
        """It is None, so that others are asked."""
        assert self.adapter.type_named("no/such/Type") is None
        assert self.adapter.type_of_schema(Schema("no/such/Type", "no such encoding", b"?")) is None

    def test_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        """Is an error of the user's, which names it; an adapter that defines no types by files takes none."""
        endings = self.adapter.endings if isinstance(self.adapter, TakesFiles) else [".none"]
        assert all(ending.startswith(".") for ending in endings)
        with pytest.raises(ConfigError):
            self.adapter.load([tmp_path / f"missing{endings[0]}"])

    def test_listed_types_are_known(self) -> None:
        """What is listed is found."""
        for name in islice(self._able(ListsTypes).type_names(), _LISTED):
            assert isinstance(self.adapter.type_named(name), MessageType), name

    def test_tokens_are_read(self) -> None:
        """The samples say something, and the adapter asks for tokens like these."""
        adapter = self._able(ParsesTokens)
        assert self.tokens
        for token in self.tokens:
            assert isinstance(adapter.announcement(token), Announcement), token
            assert any(key_matches(expression, token) for expression in adapter.announcements), token

    @SETTINGS
    @given(data=st.data())
    def test_hostile_tokens(self, data: st.DataObject) -> None:
        """Tokens of strangers are read or ignored."""
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
        """Attachments of strangers are read or ignored; keys of unknown types have a definition, or none."""
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
        """Who is asked for a type may answer anything."""
        adapter = self._able(DiscoversTypes)
        key = data.draw(_texts(list(self.keys)))
        answers = data.draw(st.lists(st.binary(max_size=80), max_size=3))
        if adapter.missing(key):
            tokens = [*self.tokens, data.draw(_texts(self.tokens))]
            assert adapter.learn(key, tokens, answers, lambda *_: answers) is None

    def test_servers_are_announced_as_others_are(self) -> None:
        """What announces a server is read as one of the same key, by the adapter itself; a topic has no server."""
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
        """A recorded topic keeps its name, and who publishes it can be read by the adapter itself."""
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
        """What is not of its kind is not published its way."""
        schema = Schema("x", "no such encoding", b"")
        topic = RecordedTopic("no such", "no such", keyed=True, schema=schema, encoding="no such encoding")
        assert self._able(PublishesAs).offer(topic, name=None, domain=None) is None

    def test_the_clock_is_told(self) -> None:
        """Time is told as bytes, whatever is played."""
        clock = self._able(PublishesAs).clock([], domain=None)
        if clock is not None:
            assert isinstance(clock.payload(1_500_000_000), bytes)
            self._check_identity(clock.offer)

    def test_files_are_converted(self) -> None:
        """Each message of the sample is packed again, and unpacked as it was."""
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
        """Files of strangers are read as far as they can be."""
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
        """Return the adapter as one with a capability; skip the test if it is not meant to have it."""
        if capability not in self.capabilities:
            pytest.skip(f"this adapter has no {capability.__name__}")
        assert isinstance(self.adapter, capability)
        return self.adapter


@st.composite
def _texts(draw: st.DrawFn, samples: Sequence[str]) -> str:
    """Return any text, or a sample of which a part was replaced."""
    if not samples or draw(st.integers(0, 4)) == 0:
        return draw(st.text(max_size=40))
    sample = draw(st.sampled_from(samples))
    start = draw(st.integers(0, len(sample)))
    end = draw(st.integers(start, len(sample)))
    return sample[:start] + draw(st.text(max_size=8) | st.sampled_from(["/", "*", "**", "%", ":", "@"])) + sample[end:]
