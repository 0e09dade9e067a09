"""Which test files a change concerns: those that import a changed module, directly or through others.

    python -m tests.changed [BASE]      names them; BASE is a commit, else that at which this branch has left main

Imports are found by their text, those inside functions too, but not those for type hints alone; so are texts of our
source that name a module, or all of a package. What a test starts as a process or finds by an entry point is not seen:
the whole gate is for that.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

__all__ = ["changed_files", "concerned"]

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("riot_bus", "adapters/*", "dictionaries/*", "extensions/*", "tests")
CONTAINERS = re.compile(r"^(?:adapters|dictionaries|extensions|tests/e2e(?=/\w+\.py))/")
"""Folders that are on the path of imports themselves."""

OF_ALL = {"pyproject.toml", "requirements.lock", "tests/conftest.py", "tests/tiers.py"}
"""Files that concern every test."""

HINTS = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+.*\n|\n)+", re.MULTILINE)
IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|.*)|import[ \t]+([\w., \t]+))", re.MULTILINE
)

NAMED = re.compile(r"[\"'](riot_bus\w*\.[\w.]+)[:\"'{]")


def changed_files(base: str = "") -> set[str]:
    """Return the paths of files that differ from a commit (that at which this branch has left main), or are new."""
    for main in () if base else ("main", "origin/main"):
        base = base or _git("merge-base", "HEAD", main).strip()
    found = _git("diff", "--name-only", "--no-renames", base or "HEAD", "--") + _git(
        "ls-files", "--others", "--exclude-standard"
    )
    return set(found.splitlines())


def concerned(changed: Iterable[str]) -> set[Path]:
    """Return the test files that changed files concern."""
    files = {str(path.relative_to(ROOT)) for each in FOLDERS for path in ROOT.glob(f"{each}/**/*.py")}
    tests = {path for path in files if Path(path).name.startswith("test_")}
    changed = set(changed)
    if changed & OF_ALL:
        return {ROOT / path for path in tests}
    texts = {path: (ROOT / path).read_text(encoding="utf-8") for path in files}
    paths = {_module(path): path for path in files | changed if path.endswith(".py")}
    importers: defaultdict[str, set[str]] = defaultdict(set)
    for path, text in texts.items():
        for name in _imports(text):
            importers[paths.get(name, "")].add(path)
        for name in () if path.startswith("tests/") else NAMED.findall(text):
            for each in (each for each in paths if (each.startswith(name) if name.endswith(".") else each == name)):
                importers[paths[each]].add(path)
    reached, rest = set(changed), sorted(changed)
    while rest:
        path = rest.pop()
        new = importers[path] if path.endswith(".py") else _readers(path, texts)
        if path.endswith("/__init__.py"):
            new = new | {other for other in files if other.startswith(path.removesuffix("__init__.py"))}
        rest += new - reached
        reached |= new
    return {ROOT / path for path in reached & tests}


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout


def _module(path: str) -> str:
    return CONTAINERS.sub("", path).removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _imports(text: str) -> Iterator[str]:
    for source, names, modules in IMPORT.findall(HINTS.sub("", text)):
        if source:
            yield source
            yield from (f"{source}.{name}" for name in re.findall(r"(?:^|[(,])\s*(\w+)", names))
        else:
            yield from re.findall(r"[\w.]+", modules)


def _readers(path: str, texts: dict[str, str]) -> set[str]:
    """Return the modules beside a file that is none, or the tests that name the folder in which it lies."""
    beside = {other for other in texts if Path(other).parent in Path(path).parents and not other.startswith("tests/")}
    above = Path(path).parts[:-1]
    word = re.compile(rf"\b{re.escape(above[1] if above[:1] == ('examples',) and above[1:] else Path(path).name)}\b")
    return beside or {other for other, text in texts.items() if other.startswith("tests/") and word.search(text)}


if __name__ == "__main__":
    print("\n".join(sorted(str(path.relative_to(ROOT)) for path in concerned(changed_files(*sys.argv[1:2])))))
