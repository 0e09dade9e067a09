"""Packages of somebody else, for tests of what plug-ins can do."""

from __future__ import annotations

import importlib.metadata
import itertools
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from riot_bus import plugins

_NUMBERS = itertools.count()


@pytest.fixture
def plugin_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Return a function that installs a package, from its code, a group of entry points and their targets by name."""
    modules = []

    def install(code: str, group: str, **targets: str) -> str:
        module = f"package_of_others_{next(_NUMBERS)}"
        modules.append(module)
        folder = tmp_path / "site" / module
        info = folder / f"{module}-1.0.dist-info"
        info.mkdir(parents=True)
        (folder / f"{module}.py").write_text(code, encoding="utf-8")
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n", encoding="utf-8")
        points = "".join(f"{name} = {module}:{target}\n" for name, target in targets.items())
        (info / "entry_points.txt").write_text(f"[{group}]\n{points}", encoding="utf-8")
        monkeypatch.syspath_prepend(folder)
        plugins._installed.cache_clear()
        return module

    yield install
    monkeypatch.undo()
    plugins._installed.cache_clear()
    for module in modules:
        sys.modules.pop(module, None)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Return a function that makes these entry points of a group, targets by name, the only ones of other packages."""

    def install(group: str, **targets: str) -> None:
        points = EntryPoints(EntryPoint(name, target, group) for name, target in targets.items())
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda: points)
        plugins._installed.cache_clear()

    yield install
    monkeypatch.undo()
    plugins._installed.cache_clear()
