"""The pictures of the documentation are what `docs/pictures.py` draws, small, and shown on some page."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
SHOWN = sorted((DOCS / "pictures").glob("*.svg"))


@pytest.fixture(scope="module")
def drawn() -> dict[str, str]:
    pytest.importorskip("jinja2")
    found: dict[str, str] = runpy.run_path(str(DOCS / "pictures.py"))["pictures"]()
    return found


def test_each_picture_is_what_the_code_draws(drawn: dict[str, str]) -> None:
    kept = {path.stem: path.read_text(encoding="utf-8") for path in SHOWN}
    assert kept.keys() == drawn.keys()
    for name, svg in kept.items():
        assert svg == drawn[name], f"{name}: python docs/pictures.py draws it again"


@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.stem)
def test_a_picture_is_small_and_on_a_page(path: Path) -> None:
    assert path.stat().st_size < 40_000
    pages = [DOCS.parent / "README.md", *DOCS.glob("*.md")]
    assert any(f"pictures/{path.name})" in page.read_text(encoding="utf-8") for page in pages)


def test_pictures_have_colours_for_light_and_dark_pages(drawn: dict[str, str]) -> None:
    for svg in drawn.values():
        assert "prefers-color-scheme: dark" in svg
        used, told = (set(re.findall(one, svg)) for one in (r"var\((--\w+)\)", r"(--\w+):"))
        assert used <= told
