"""The schema that is published is that of the files that are read."""

from __future__ import annotations

import pytest

from riot_bus.inject.dictionary import installed_files
from riot_bus.inject.dictionary_file import DictionaryFile, binds, json_schema, plain_value, read_file
from riot_bus.vocabulary.errors import ConfigError


def test_the_schema_knows_all_that_is_read_and_tells_what_it_is() -> None:
    found = json_schema()
    assert set(found["properties"]) == set(DictionaryFile.model_fields)
    assert found["additionalProperties"] is False
    described = found["$defs"]["RawField"]["properties"]
    assert all("description" in described[name] for name in ("path", "type", "only"))
    assert "float32" in str(described["type"])


def test_shipped_files_are_read_as_they_are_written() -> None:
    files = [read_file(text, where=name) for name, text in installed_files()]
    assert sum(len(each.entry) for each in files) > 300
    assert sum(len(each.message) for each in files) > 100


def test_values_are_put_together() -> None:
    text = """
    [[entry]]
    value = { repeat = { hex = "00ff" }, times = 2 }
    reason = "r"
    """
    (entry,) = read_file(text, where="a").entry
    assert plain_value(entry.value) == b"\x00\xff\x00\xff"
    with pytest.raises(ConfigError, match="a: entri"):
        read_file("entri = 1", where="a")


def test_patterns_mean_paths_with_or_without_their_topic() -> None:
    assert binds("*.x", "/odom:pose.x")
    assert binds("/odom:*", "/odom:pose.x")
    assert binds("ranges[0]", "/scan:ranges[0]")
    assert not binds("ranges[0]", "/scan:ranges0")
