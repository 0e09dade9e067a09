"""Processes that are kept over trials: their folder, and their end."""

from __future__ import annotations

import os
from contextlib import ExitStack
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from riot_bus.trial.kept import FOLDER_PREFIX, KeptSetup, end_kept, kept_folder

if TYPE_CHECKING:
    from pathlib import Path


class _Notes(KeptSetup):
    def __init__(self, notes: list[str], name: str, *, works: bool = True) -> None:
        self._notes, self._name, self._works = notes, name, works

    def _open(self, stack: ExitStack) -> Any:
        stack.callback(self._notes.append, f"{self._name} closed")
        if not self._works:
            raise OSError("it does not start")
        return None


def test_all_that_is_kept_is_ended_last_first() -> None:
    notes: list[str] = []
    place: Any = SimpleNamespace(kept=[_Notes(notes, name).__enter__() for name in ("first", "second")])
    end_kept(place)
    assert (place.kept, notes) == ([], ["second closed", "first closed"])


def test_what_cannot_be_opened_leaves_nothing_behind() -> None:
    notes: list[str] = []
    with pytest.raises(OSError, match="start"), _Notes(notes, "it", works=False):
        pass
    assert notes == ["it closed"]


def test_the_folder_is_beside_that_of_the_trial_and_goes_at_the_end(tmp_path: Path) -> None:
    place: Any = SimpleNamespace(directory=tmp_path / "trial")
    with ExitStack() as stack:
        folder = kept_folder(place, stack)
        assert folder.parent == tmp_path
        assert folder.name.startswith(FOLDER_PREFIX.format(os.getpid()))
        (folder / "log").write_text("")
    assert not list(tmp_path.iterdir())
