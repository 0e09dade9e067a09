"""The page on adapters: its adapter holds what it promises, and its tables are complete."""

import re
import sys
from pathlib import Path
from typing import ClassVar

import pytest

from riot_bus.types import capabilities
from riot_bus.types.capabilities import ParsesTokens
from riot_bus.types.model import Adapter, TopicName
from riot_bus.types.registry import TypeRegistry
from riot_bus_bridges import bridging
from riot_bus_testkit.adapters import AdapterConformance

PAGE = (Path(__file__).parents[3] / "docs" / "adapters.md").read_text(encoding="utf-8")
ADAPTER, TESTS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
PROTOCOLS = {
    name: each
    for name, each in vars(capabilities).items()
    if getattr(each, "_is_runtime_protocol", False) and each.__module__ == capabilities.__name__
}


def namespace(code, **given):
    exec(compile(code, "docs/adapters.md", "exec"), given)
    return given


ToyAdapter = namespace(ADAPTER, __name__="my_package")["ToyAdapter"]


class TestToys(AdapterConformance):
    adapter = ToyAdapter()
    keys: ClassVar = {"toy/odom/Pose": TopicName("/odom", "Pose")}
    types = ("Pose", "Twist")
    foreign = ("", "toy", "0/odom/x/y")
    capabilities = (ParsesTokens,)
    tokens = ("@toy/3f2a/mapper/odom/Pose",)


def test_the_class_of_tests_on_the_page_is_this_one(monkeypatch):
    module = type(sys)("my_package")
    module.ToyAdapter = ToyAdapter
    monkeypatch.setitem(sys.modules, "my_package", module)
    theirs = namespace(TESTS, __name__="test_my_package")["TestToys"]
    assert issubclass(theirs, AdapterConformance)
    for name in ("keys", "types", "foreign", "capabilities", "tokens"):
        assert getattr(theirs, name) == getattr(TestToys, name)


def test_the_adapter_on_the_page_works():
    registry = TypeRegistry([ToyAdapter()])
    assert registry.topic("toy/odom/Pose") == "/odom"
    assert registry.matches("/odom", "toy/odom/Twist")
    assert registry.type_of("toy/odom/Pose").read(b'{"x": 1}', "x") == 1
    assert registry.announcement("@toy/3f2a/mapper/odom/Pose").node == "mapper"


def members(protocol):
    return {*vars(protocol), *getattr(protocol, "__annotations__", ())} - {
        name for name in vars(protocol) if name.startswith("_")
    }


@pytest.mark.parametrize("name", PROTOCOLS)
def test_each_capability_is_described(name):
    (row,) = re.findall(rf"^\| `{name}` \| (.*?) \|", PAGE, re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", row)) == members(PROTOCOLS[name])


def test_what_an_adapter_must_have_is_described():
    table = PAGE.partition("## What an adapter must have")[2].partition("```")[0]
    wanted = {name for kind in Adapter.__mro__ for name in members(kind) if not name.startswith("_")}
    assert set(re.findall(r"^\| `(\w+)", table, re.MULTILINE)) == wanted


def test_bridges_are_described():
    assert all(hasattr(bridging, name) for name in re.findall(r"riot_bus\.types\.bridging\.(\w+)", PAGE))
    assert all(f"{name}(" in PAGE for name in ("ports", "run"))
