"""The conformance class of kinds of faults holds for the shipped ones, and finds what is wrong with others."""

from __future__ import annotations

import pytest

from riot_bus.inject.faults import fault_class
from riot_bus.inject.plan import parse_plan
from riot_bus.plugins import FAULTS
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.faults import FaultConformance

TABLES = {
    "set": 'field = "x"\nvalue = -1',
    "drop": 'fault = "drop"',
    "delay": 'fault = "delay"\ndelay = 0.5',
    "duplicate": 'fault = "duplicate"\ncopies = 2',
    "omit": 'fault = "omit"\nfield = "x"',
    "truncate": 'fault = "truncate"\nkeep = 0.5',
}
SCALE = """
import random
from dataclasses import dataclass

@dataclass(frozen=True)
class Scale:
    factor: float = 2.0
    def apply(self, event):
        event.set("x", event.read("x") * self.factor)

@dataclass(frozen=True)
class Dice:
    def apply(self, event):
        if random.random() < 0.5:
            event.drop()
"""


def test_there_is_a_sample_of_each_shipped_one() -> None:
    assert TABLES.keys() == set(FAULTS.targets())


@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
class TestShipped(FaultConformance):
    @pytest.fixture(autouse=True)
    def _chosen(self, table: str) -> None:
        type(self).table = table


@pytest.fixture
def others(plugin_package):
    plugin_package(SCALE, "riot_bus.faults", scale="Scale", dice="Dice", number="__name__")
    yield
    fault_class.cache_clear()


@pytest.mark.usefixtures("others")
class TestOneOfAnotherPackage(FaultConformance):
    table = 'fault = "scale"\nfactor = 3.0'


@pytest.mark.usefixtures("others")
def test_its_options_are_checked_as_those_of_shipped_ones() -> None:
    (found,) = parse_plan('[[inject]]\ntopic = "a"\nfault = "scale"\nfactor = 2', name="plan")
    assert found.options == (("factor", 2),)
    for table, words in (
        ('fault = "scale"\nfaktor = 2', "did you mean 'factor'"),
        ('fault = "scale"\nfactor = "much"', "valid number"),
        ('fault = "scale"\nfield = "x"\nvalue = 1', "takes no field"),
        ('fault = "number"', "cannot be used"),
    ):
        with pytest.raises(ConfigError, match=words):
            parse_plan(f'[[inject]]\ntopic = "a"\n{table}', name="plan")


@pytest.mark.usefixtures("others")
def test_one_that_rolls_dice_of_its_own_is_found() -> None:
    case = type("Case", (FaultConformance,), {"table": 'fault = "dice"'})()
    with pytest.raises(AssertionError):
        case.test_it_repeats_itself()
