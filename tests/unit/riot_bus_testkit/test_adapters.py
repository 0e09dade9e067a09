"""Adapters that break a promise are found out."""

from __future__ import annotations

import pytest

from riot_bus.types.capabilities import Announcement, ParsesTokens, Stamp
from riot_bus.types.json_type import JsonType
from riot_bus.types.model import Schema, TopicName
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.adapters import AdapterConformance


class Named(JsonType):
    def __init__(self, name):
        self.name = name


class Good:
    """Keys `a/NAME`, topics `/NAME`, the type `T`, tokens `@a/NAME`."""

    name = "good"
    announcements = ("@a/*",)

    def topic(self, key):
        return TopicName("/" + key[2:], "T") if key.startswith("a/") else None

    def key_expression(self, topic):
        return f"a{topic}" if topic.startswith("/") else None

    def load(self, files):
        raise ConfigError("no files")

    def type_named(self, type_name):
        return Named("T") if type_name == "T" else None

    def type_of_schema(self, schema):
        return None

    def announcement(self, token):
        found = token.removeprefix("@a/")
        return None if found == token else Announcement("1", "publishes", found, "", "/" + found, "T", "token")


class Renaming(Good):
    def key_expression(self, topic):
        return f"b{topic}" if topic.startswith("/") else None


class Greedy(Good):
    def type_named(self, type_name):
        return Named("T")


class Forgetful(Good):
    def type_named(self, type_name):
        return Named("U") if type_name == "T" else None


class FragileNames(Good):
    def type_named(self, type_name):
        return {"T": Named("T")}[type_name]


class FragileSchemas(Good):
    def type_of_schema(self, schema):
        return Named(schema.data.decode()) if schema.encoding == "" else None


class FragileTokens(Good):
    def announcement(self, token):
        return super().announcement("/".join(token.split("/", 1)[:2])) if token.split("/")[1] else None


class OtherTokens(Good):
    announcements = ("@b/*",)


class Half(Good):
    def stamp(self, attachment):
        return Stamp(1, 2, b"")


class Undeclared(Good):
    endings = (".a",)


class Silent(Good):
    def load(self, files):
        pass


def conformance(adapter, **changes):
    keys = {"a/odom": TopicName("/odom", "T")}
    given = {"adapter": adapter, "keys": keys, "types": ("T",), "capabilities": (ParsesTokens,), "tokens": ("@a/odom",)}
    return type("Conformance", (AdapterConformance,), given | changes)()


class TestGood(AdapterConformance):
    adapter = Good()
    keys = conformance(Good()).keys
    types = ("T",)
    capabilities = (ParsesTokens,)
    tokens = ("@a/odom",)


@pytest.mark.parametrize(
    ("kind", "test"),
    [
        (Renaming, "test_names_stand_for_keys"),
        (Greedy, "test_a_type_that_does_not_exist"),
        (Forgetful, "test_types_have_names"),
        (OtherTokens, "test_tokens_are_read"),
        (Half, "test_capabilities_that_are_declared_hold"),
        (Undeclared, "test_capabilities_that_are_declared_hold"),
    ],
)
def test_broken_promises_are_found(kind, test):
    with pytest.raises(AssertionError):
        getattr(conformance(kind()), test)()


def test_files_that_are_ignored_are_found(tmp_path):
    with pytest.raises(pytest.fail.Exception):
        conformance(Silent()).test_a_file_that_is_not_there(tmp_path)


def test_names_and_schemas_and_tokens_that_raise_are_found():
    with pytest.raises(KeyError):
        conformance(FragileNames()).test_unknown_names_return_none()
    with pytest.raises(UnicodeDecodeError):
        conformance(FragileSchemas()).test_unknown_names_return_none()
    with pytest.raises(IndexError):
        conformance(FragileTokens()).test_hostile_tokens()


def test_what_is_half_there_is_named():
    with pytest.raises(AssertionError, match="ReadsMetadata also needs definition, details"):
        conformance(Half()).test_capabilities_that_are_declared_hold()


def test_a_wrong_sample_is_found():
    with pytest.raises(AssertionError):
        conformance(Good(), keys={"b/odom": TopicName("/odom", "T")}).test_keys_have_names()
    assert Good().type_of_schema(Schema("T", "", b"")) is None
