"""The page on types: its codec holds what it promises, and its tables are true."""

import re
import sys
from pathlib import Path

import pytest

from riot_bus.types.codecs import _DEFINITIONS, Codecs
from riot_bus.types.model import MOST_BYTES
from riot_bus.types.registry import TypeRegistry
from riot_bus_protobuf.units import unit_in
from riot_bus_testkit.types import TypeConformance

PAGE = (Path(__file__).parents[3] / "docs" / "types.md").read_text(encoding="utf-8")
CODEC, TESTS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def namespace(code, **given):
    exec(compile(code, "docs/types.md", "exec"), given)
    return given


PAIRS = namespace(CODEC, __name__="my_package")["PairsType"]


class TestPairs(TypeConformance):
    kind = PAIRS()
    payloads = (b"left=12;right=-3;", b"a=0;")


def test_the_class_of_tests_on_the_page_is_this_one(monkeypatch):
    module = type(sys)("my_package")
    module.PairsType = PAIRS
    monkeypatch.setitem(sys.modules, "my_package", module)
    theirs = namespace(TESTS, __name__="test_my_package")["TestPairs"]
    assert issubclass(theirs, TypeConformance)
    assert theirs.payloads == TestPairs.payloads


def test_the_codec_is_as_short_as_it_says():
    lines = [line for line in CODEC.splitlines() if line.strip() and "import" not in line]
    assert len(lines) <= 33


def test_the_table_of_codecs():
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\| (.*?) \|", PAGE, re.MULTILINE)
    codecs = Codecs()
    assert sorted(name for name, _ in rows) == codecs.names()
    for name, encodings in rows:
        for encoding in re.findall(r"`(.*?)`", encodings):
            assert codecs.of_encoding(encoding) is codecs.load(name)


def test_endings_of_definitions():
    assert all(f"`{ending}`" in PAGE for ending in _DEFINITIONS)


def test_the_structure_on_the_page():
    name = re.search(r'"imu/raw" = "(.*)"', PAGE).group(1)
    assert TypeRegistry(declared={"imu/raw": name}).type_of("imu/raw").read(bytes(22), "temperature") == 0


@pytest.mark.parametrize("comment", ["[m/s]", "(rad)", "unit: Hz", "in metres"])
def test_forms_of_units(comment):
    assert f"`{comment}`" in PAGE
    assert unit_in(comment)


def test_the_limit():
    assert f"{MOST_BYTES >> 20} MiB" in PAGE
