"""Hook of mkdocs: pages that lie at the root of the repository, and links from pages to files that are no pages.

README.md is the index. Links to code and examples lead to `repo_url` if mkdocs.yml has one; otherwise only their text
stays.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Pages of the site by their paths in the repository; those below `docs/` keep their names."""
_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s:#]+)(#[^()\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages from the root of the repository."""
    for path, page in PAGES.items():
        text = (ROOT / path).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=_linked(text, folder="", repository=config.repo_url)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Mend the links of a page of `docs/`."""
    if page.file.src_uri in PAGES.values():
        return markdown
    return _linked(markdown, folder="docs", repository=config.repo_url)


def _linked(text: str, *, folder: str, repository: str | None) -> str:
    """Return a page's text with links that work on the site.

    Args:
        text: Markdown.
        folder: Folder of the page in the repository.
        repository: Address of the repository; None if there is none.
    """

    def link(found: re.Match[str]) -> str:
        label, target, anchor = found[1], found[2], found[3] or ""
        path = posixpath.normpath(posixpath.join(folder, target))
        if path in PAGES or (path.startswith("docs/") and (ROOT / path).is_file()):
            return f"[{label}]({PAGES.get(path, path.removeprefix('docs/'))}{anchor})"
        if not (ROOT / path).exists():
            return found[0]  # mkdocs says that it leads nowhere
        return f"[{label}]({repository.rstrip('/')}/blob/main/{path}{anchor})" if repository else label

    return _LINK.sub(link, text)
