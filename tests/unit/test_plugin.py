"""`riot_bus.plugin` has every name that it lists, and the documentation sends authors nowhere else."""

from __future__ import annotations

import ast
import re
import textwrap
from pathlib import Path

import pytest

from riot_bus import plugin

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
PACKAGES = {path.parent.name for place in ("adapters", "extensions") for path in ROOT.glob(f"{place}/*/__init__.py")}
PUBLIC = {"riot_bus", "riot_bus.plugin", *PACKAGES}


def blocks(page: Path) -> list[str]:
    """Return the Python of a page: fenced blocks, and indented ones that import something of riot's."""
    text = page.read_text(encoding="utf-8")
    fenced = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    indented = re.findall(
        r"(?:^(?: {4}.*)?\n)+", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL), re.MULTILINE
    )
    return [
        *fenced,
        *(textwrap.dedent(each) for each in indented if re.search(r"^ +(from|import) riot_bus", each, re.MULTILINE)),
    ]


@pytest.mark.parametrize("name", sorted(plugin._PLACES))
def test_each_name_is_there(name: str) -> None:
    assert getattr(plugin, name) is not None
    assert name in dir(plugin)


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Leafs'"):
        _ = plugin.Leafs


def test_type_checkers_see_each_name_where_it_is_imported_from() -> None:
    tree = ast.parse(Path(plugin.__file__).read_bytes())
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    seen = {name.asname: node.module for node in imports for name in node.names}
    assert seen == {name: f"riot_bus.{place}" for name, place in plugin._PLACES.items()}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_imports_public_modules_alone(page: Path) -> None:
    for block in blocks(page):
        for node in ast.walk(ast.parse(block)):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
            assert {name for name in names if name.startswith("riot_bus")} <= PUBLIC


def test_pages_that_import_something_are_looked_at() -> None:
    assert {page.stem for page in PAGES if any("riot_bus" in block for block in blocks(page))} >= {
        "extending",
        "record",
    }
