from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.scan import ScanRule
from tests.unit.riot_bus_fleet.test_scan import write_rule

BOTH = Rule(((Literal(Feature("raw", ("a:x",)), ">", 5), Literal(Feature("raw", ("a before b",)), "==", True)),))


def test_a_rule_file_says_which_topics_are_read(tmp_path: Path) -> None:
    folder = write_rule(tmp_path, BOTH, "a", "b")
    for source in (folder, folder / "rule.json"):
        found = ScanRule(source)
        assert (found.read, found.keeps, found.topics) == (("a", "b"), False, ("a", "b"))


def test_a_distance_is_told_in_spreads(tmp_path: Path) -> None:
    rule = Rule(((Literal(Feature("raw", ("a:x",)), ">", 5),),))
    found = ScanRule(write_rule(tmp_path, rule, "a", a_x=2.0))
    distance = found.distance({"a:x": np.array([1.0, 9.0])}, 2)
    assert distance[0] == pytest.approx(2.0)
    assert distance[1] <= 0


def test_a_folder_without_a_rule_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"rule\.json does not exist"):
        ScanRule(tmp_path)
