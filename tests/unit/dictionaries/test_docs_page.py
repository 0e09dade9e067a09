"""docs/dictionaries.md shows files that can be read, and names all that ships."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

from riot_bus.inject.dictionary import Dictionary, load_dictionary

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "dictionaries.md").read_text()


def test_examples_are_read() -> None:
    blocks = [
        textwrap.dedent(each) for each in re.findall(r"(?:^(?: {4}.*)?\n)+", PAGE, re.MULTILINE) if "reason" in each
    ]
    dictionary = Dictionary()
    for number, block in enumerate(blocks):
        dictionary.add(block, where=f"example {number}", own=True)
    assert len(blocks) == 2
    assert {entry.reason for entry in dictionary.values_for("float64", "twist.linear.x")} == {"faster than any robot"}
    assert dictionary.mutated_types() == ("sensor_msgs/msg/Image",)


def test_all_packages_are_named() -> None:
    packages = {name.split("/")[0] for name in load_dictionary().mutated_types()}
    table = PAGE.partition("## What ships for ROS 2")[2]
    assert {name for name in packages if f"`{name}`" not in table} == set()
