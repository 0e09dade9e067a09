from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.zenoh import sockets
from riot_bus.zenoh.junction_sockets import JunctionSockets


@pytest.fixture
def links(tmp_path: Path) -> JunctionSockets:
    """A junction that connects to two doors and listens at one place."""
    for name in ("door-0", "door-1", "inner"):
        (tmp_path / name).touch()
    doors = [f"unixsock-stream/{tmp_path}/door-{number}" for number in range(2)]
    return JunctionSockets(doors, [f"unixsock-stream/{tmp_path}/inner"])


def names(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


def test_doors_are_hidden_before_links_end_and_open_for_the_next(
    links: JunctionSockets, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[Any] = []
    monkeypatch.setattr(sockets, "hang_up", lambda **ends: ended.append((names(tmp_path), ends)))
    links.end()
    doors = {f"{tmp_path}/door-0", f"{tmp_path}/door-1"}
    assert ended == [(["door-0~", "door-1~"], {"accepted": {f"{tmp_path}/inner"}, "connected": doors})]
    links.reopen()
    links.reopen()
    assert names(tmp_path) == ["door-0", "door-1"]


def test_files_that_others_removed_do_not_matter(
    links: JunctionSockets, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sockets, "hang_up", lambda **ends: None)
    for name in ("door-0", "inner"):
        (tmp_path / name).unlink()
    links.end()
    (tmp_path / "door-1~").unlink()
    links.reopen()
    assert names(tmp_path) == []


def test_all_links_are_widened(links: JunctionSockets, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    widened: list[Any] = []
    monkeypatch.setattr(sockets, "widen", widened.append)
    links.widen()
    assert widened == [{f"{tmp_path}/{name}" for name in ("door-0", "door-1", "inner")}]
