"""The site of the documentation builds without warnings: no link of any page leads nowhere."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from tests.interop import MKDOCS, require

ROOT = Path(__file__).resolve().parents[2]


def build(root: Path, site: Path) -> subprocess.CompletedProcess[str]:
    words = [require(MKDOCS), "-m", "mkdocs", "build", "--strict", "-f", root / "mkdocs.yml", "-d", site]
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=120, check=False)


def test_it_builds_without_warnings(tmp_path: Path) -> None:
    done = build(ROOT, tmp_path / "site")
    assert done.returncode == 0, done.stderr
    pages = {path.parent.name for path in tmp_path.glob("site/*/index.html")}
    assert pages >= {path.stem for path in (ROOT / "docs").glob("*.md")} | {"architecture", "changelog"}
    assert 'href="tutorial/"' in (tmp_path / "site" / "index.html").read_text(encoding="utf-8")


def test_a_link_that_leads_nowhere_is_told(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    for name in ("mkdocs.yml", *(path.name for path in ROOT.glob("*.md"))):
        shutil.copy(ROOT / name, tmp_path)
    page = tmp_path / "docs" / "tutorial.md"
    page.write_text(page.read_text(encoding="utf-8") + "\nSee [limits](limits.md#no-such-limit).\n", encoding="utf-8")
    done = build(tmp_path, tmp_path / "site")
    assert done.returncode != 0
    assert "no-such-limit" in done.stderr
