"""ARCHITECTURE.md is short, and what it and the pages beside it name exists."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAP = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
ROOMS = {
    path.stem for path in (ROOT / "riot_bus").iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()
}
PACKAGES = {path.parent.name for place in ("adapters", "extensions") for path in ROOT.glob(f"{place}/*/__init__.py")}
PAGES = ["ARCHITECTURE.md", "SECURITY.md", *(f"docs/{path.name}" for path in (ROOT / "docs").glob("inside-*.md"))]


def is_there(name: str) -> bool:
    """Return whether a dotted name leads to a module, or to something in one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def test_it_is_a_map() -> None:
    assert len(MAP.split()) <= 1000
    ways = re.findall(r"^## The way of an? .*?\n(.*?)(?=^## |\Z)", MAP, re.MULTILINE | re.DOTALL)
    assert [len(re.findall(r"^\d+\. ", way, re.MULTILINE)) <= 10 for way in ways] == [True, True]


def test_it_has_every_room_and_package() -> None:
    table = set(re.findall(r"`(?:extensions/|adapters/)?(\w+)`", MAP))
    assert ROOMS - {"__init__", "__main__"} <= table
    assert table >= PACKAGES


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_names_is_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    files = re.findall(r"`([a-z_]+/[a-z_/]+\.py)`", text)
    assert [name for name in files if not (ROOT / "riot_bus" / name).exists()] == []
    dotted = {
        name
        for name in re.findall(r"`([a-z_0-9]+(?:\.[A-Za-z_]+)+)`", text)
        if name.partition(".")[0] in ROOMS | PACKAGES
    }
    full = {name if name.partition(".")[0] in PACKAGES else f"riot_bus.{name}" for name in dotted}
    assert {name for name in full if not is_there(name)} == set()
