"""Systems that are kept over runs: their end, and what is removed then."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.system.system_file import Reset, RunPace
from riot_bus.trial.running_system import FOLDER_PREFIX, RealTimeSystem, end_kept


class _Setup:
    def __init__(self, notes: list[str], *, works: bool = True) -> None:
        self._notes, self._works = notes, works

    def __enter__(self) -> _Setup:
        if not self._works:
            raise OSError("it does not start")
        return self

    def __exit__(self, *_: object) -> None:
        self._notes.append("closed")


def system(folder: Path, setup: _Setup, folders: list[Path], names: Sequence[str] = ("part",)) -> RealTimeSystem:
    """Return a system that can be reset, in a place where `setup` stands for its processes."""
    component = SimpleNamespace(resources={}, attach=None, external=False)
    file = SimpleNamespace(
        components=dict.fromkeys(names, component),
        external=SimpleNamespace(topics=()),
        system=SimpleNamespace(segments=("system",)),
    )
    context = SimpleNamespace(file=file, topics=lambda *_: [], registry=None)

    def set_up(*, directory: Path, **_: object) -> _Setup:
        folders.append(directory)
        return setup

    place: Any = SimpleNamespace(context=context, directory=folder / "trial", setup=set_up)
    reset = Reset(topic="reset")
    options: dict[str, Any] = {"seed": 0, "pace": RunPace(duration=1.0), "parameters": {}, "timeout": 1.0, "stall": 1.0}
    return RealTimeSystem(place, names, [], [], reset=reset, **options)


def test_all_that_is_kept_is_ended_last_first() -> None:
    notes: list[str] = []

    class Kept:
        def __init__(self, name: str) -> None:
            self.name = name

        def __exit__(self, *_: object) -> None:
            notes.append(self.name)

    place: Any = SimpleNamespace(kept=[Kept("first"), Kept("second")])
    end_kept(place)
    assert (place.kept, notes) == ([], ["second", "first"])


def test_its_folder_is_beside_that_of_the_trial_and_goes_at_the_end(tmp_path: Path) -> None:
    notes: list[str] = []
    folders: list[Path] = []
    with system(tmp_path, _Setup(notes), folders):
        (folder,) = folders
        assert folder.parent == tmp_path
        assert folder.name.startswith(FOLDER_PREFIX.format(os.getpid()))
        (folder / "log").write_text("")
    assert notes == ["closed"]
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_opened_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="start"), system(tmp_path, _Setup([], works=False), []):
        pass
    assert not list(tmp_path.iterdir())
