from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

from riot_bus.zenoh.socket_folder import socket_folder

HOLDS = """
import sys, tempfile
from riot_bus.zenoh.socket_folder import socket_folder
tempfile.tempdir = sys.argv[1]
with socket_folder() as folder:
    (folder / "door-0.lock").touch()
    print(folder, flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(path))


def test_a_folder_is_there_for_this_user_alone_and_gone_in_the_end() -> None:
    with socket_folder() as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
        bind(folder / "door-0-0")
    assert not folder.exists()


def test_what_a_killed_process_has_left_is_removed_and_what_is_in_use_stays(place: Path) -> None:
    command = [sys.executable, "-c", HOLDS, str(place)]
    lives, killed = (subprocess.Popen(command, stdin=-1, stdout=-1, text=True) for _ in range(2))
    with lives, killed:
        used, left = (Path((each.stdout or sys.stdin).readline().strip()) for each in (lives, killed))
        with socket_folder() as folder:
            assert set(place.iterdir()) == {used, left, folder}
            killed.kill()
            killed.wait()
            bind(left / "door-1")
            with socket_folder() as other:
                assert set(place.iterdir()) == {used, folder, other}
        lives.communicate("")
    assert list(place.iterdir()) == []


def test_only_what_routers_make_is_removed(place: Path) -> None:
    (place / "elsewhere").mkdir()
    (place / "elsewhere" / "my.lock").touch()
    (place / "riot-sockets-link").symlink_to(place / "elsewhere")
    (place / "riot-sockets-file").touch()
    for name, inside in (("file", "notes.txt"), ("folder", "more.lock/x.lock"), ("link", "link")):
        path = place / f"riot-sockets-with-{name}" / inside
        path.parent.mkdir(parents=True)
        path.symlink_to(place / "elsewhere" / "my.lock") if name == "link" else path.touch()
    if os.getuid() == 0:
        (place / "riot-sockets-other").mkdir()
        os.chown(place / "riot-sockets-other", 65534, 65534)
    before = {path for path in place.rglob("*") if path != place}
    with socket_folder():
        pass
    assert {path for path in place.rglob("*") if path != place} == before


def test_routers_that_begin_and_end_at_once_do_not_take_folders_of_each_other() -> None:
    wrong: list[BaseException] = []

    def use() -> None:
        try:
            for _ in range(100):
                with socket_folder() as folder:
                    bind(folder / "door")
                    assert (folder / "door").exists()
        except BaseException as error:
            wrong.append(error)

    threads = [threading.Thread(target=use) for _ in range(8)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert wrong == []
