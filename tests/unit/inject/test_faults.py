"""Kinds of faults take what a plan says; what is wrong with a kind is said when it is named."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from riot_bus.inject.faults import DelayFault, DropFault, DuplicateFault, SetFault, fault_class, fault_of
from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import parse_plan
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Formula, Injection
from riot_bus_testkit.interceptors import InterceptorBench
from tests.plans import plan_to_toml

TAG = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Tag:
    text: str = ""
    blob: bytes = b""
    how: object = None
    def apply(self, event):
        event.set("tag", self.text)

class NoClass:
    pass
"""


@pytest.fixture
def kind(plugin_package: Callable[..., str]) -> Iterator[Callable[..., None]]:
    yield lambda code, **targets: plugin_package(code, "riot_bus.faults", **targets)
    fault_class.cache_clear()


@pytest.mark.parametrize(
    ("injection", "expected"),
    [
        (Injection("a", "x", 1), SetFault("x", 1)),
        (Injection("a", fault="drop"), DropFault()),
        (Injection("a", fault="delay", delay=0.5), DelayFault(0.5)),
        (Injection("a", fault="duplicate", copies=3), DuplicateFault(3)),
    ],
)
def test_shipped_kinds_take_their_options_from_the_injection(injection: Injection, expected: object) -> None:
    assert fault_of(injection) == expected


@pytest.mark.parametrize("field", ["x", "xs[*]"])
@pytest.mark.parametrize("value", [1, Formula("x + 1")])
def test_messages_of_no_known_type_pass_as_they_are(field: str, value: object) -> None:
    injector = Injector([Injection("a", field, value)])
    with InterceptorBench(injector) as bench:
        bench.feed(0.0, b"\xff\xfe")
        assert bench.payloads() == [b"\xff\xfe"]
    assert injector.skipped == {"a": 1}


def test_options_that_a_kind_does_not_have_are_an_error_that_names_those_it_has() -> None:
    with pytest.raises(ConfigError, match=r"fault kind 'drop' does not take these options") as caught:
        fault_of(Injection("a", fault="drop", options=(("factor", 2),)))
    assert caught.value.hint == "its options: none"


def test_options_of_every_type_of_value_survive_being_written(kind: Callable[..., None]) -> None:
    kind(TAG, tag="Tag")
    (found,) = parse_plan(
        '[[inject]]\ntopic = "a"\nfault = "tag"\ntext = "a\\n\\"b\\""\nblob = { hex = "00ff" }\nhow = false',
        name="plan",
    )
    assert found.options == (("blob", b"\x00\xff"), ("how", False), ("text", 'a\n"b"'))
    assert parse_plan(plan_to_toml((found,)), name="written") == (found,)


@pytest.mark.parametrize("value", ["[1, 2]", "{ x = 1 }", '{ hex = "0" }', "2024-01-01"])
def test_an_option_is_one_value_so_that_injections_can_be_compared_and_written(
    kind: Callable[..., None], value: str
) -> None:
    kind(TAG, tag="Tag")
    with pytest.raises(ConfigError, match="an option is one value") as caught:
        parse_plan(f'[[inject]]\ntopic = "a"\nfault = "tag"\nhow = {value}', name="plan")
    assert caught.value.where == "plan: inject[0].how"


@pytest.mark.parametrize(
    "option",
    ["seed: int", "first: int = 9", "signal: str = ''", "copies: int = 3", "delay: float = 0.5", "field: str = 'x'"],
)
def test_a_kind_whose_option_would_never_reach_it_cannot_be_used(kind: Callable[..., None], option: str) -> None:
    code = (
        f"from dataclasses import dataclass\n@dataclass\nclass Mine:\n    {option}\n    def apply(self, event): ...\n"
    )
    kind(code, mine="Mine")
    name = option.partition(":")[0]
    with pytest.raises(ConfigError, match=f"'{name}' is a key of every injection") as caught:
        fault_class("mine")
    assert caught.value.hint == "give this option another name"


def test_a_kind_without_apply_cannot_be_used(kind: Callable[..., None]) -> None:
    kind(TAG, mine="NoClass")
    with pytest.raises(ConfigError, match="fault kind 'mine' cannot be used"):
        fault_class("mine")
