"""`import riot_bus` costs nothing and offers what scripts use."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import riot_bus

HEAVY = ("zenoh", "numpy", "pydantic", "mcap", "rich", "typer", "scipy", "sklearn")


@pytest.mark.parametrize("name", riot_bus.__all__)
def test_each_name_is_there(name: str) -> None:
    assert getattr(riot_bus, name) is not None
    assert name in dir(riot_bus)


def test_the_names_are_those_that_have_a_place() -> None:
    assert set(riot_bus.__all__) == set(riot_bus._PLACES)
    with pytest.raises(AttributeError, match="no attribute 'Mesage'"):
        _ = riot_bus.Mesage


def test_type_checkers_see_each_name_where_it_is_imported_from() -> None:
    tree = ast.parse(Path(riot_bus.__file__).read_bytes())
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    seen = {name.name: node.module for node in imports for name in node.names if node.module != "typing"}
    assert seen == {name: f"riot_bus.{place}" for name, place in riot_bus._PLACES.items()}


def test_importing_it_imports_nothing_heavy() -> None:
    code = f"import sys, riot_bus; print([each for each in {HEAVY!r} if each in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
