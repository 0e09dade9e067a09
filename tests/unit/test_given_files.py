"""Files and folders that others may have made."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from riot_bus.given_files import given_bytes, given_file, given_folder, given_text, leads_out, private_folder
from riot_bus.vocabulary.errors import ConfigError


def test_a_file_in_the_folder_is_read_though_the_folder_is_a_link(tmp_path: Path) -> None:
    folder = tmp_path / "real"
    folder.mkdir()
    (folder / "a.txt").write_text("é")
    (tmp_path / "link").symlink_to(folder)
    assert given_text(tmp_path / "link" / "a.txt", inside=tmp_path / "link") == "é"
    (folder / "b.txt").symlink_to("a.txt")  # a link that stays inside
    assert given_bytes(folder / "b.txt", inside=folder) == "é".encode()


@pytest.mark.parametrize("way", ["file", "folder", "relative", "chain"])
def test_no_link_leads_out_of_the_folder(tmp_path: Path, way: str) -> None:
    folder, outside = tmp_path / "handed", tmp_path / "home"
    folder.mkdir()
    outside.mkdir()
    (outside / "key").write_text("private")
    path = folder / "evidence" if way == "folder" else folder / "key"
    if way == "chain":
        (folder / "first").symlink_to(outside / "key")
    path.symlink_to({"relative": "../home/key", "chain": "first", "folder": outside}.get(way, outside / "key"))
    path = path / "key" if way == "folder" else path
    assert leads_out(path, folder)
    with pytest.raises(ConfigError, match="leads out of"):
        given_text(path, inside=folder)
    assert given_text(path) == "private"


def test_a_link_into_a_folder_of_like_name_leads_out(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "ab").mkdir()
    assert leads_out(tmp_path / "ab" / "x", tmp_path / "a")


def test_what_is_no_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(ConfigError, match="no regular file"):
            given_bytes(path)
    with pytest.raises(FileNotFoundError):
        given_file(tmp_path / "missing")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="symbolic links"):
        given_file(tmp_path / "loop", inside=tmp_path)
    assert not leads_out(tmp_path / "loop", tmp_path)


def test_a_large_file_is_refused_before_it_is_in_memory(tmp_path: Path) -> None:
    with (tmp_path / "sparse").open("wb") as stream:
        stream.truncate(1 << 40)
    with pytest.raises(ConfigError, match="more than 1000 bytes"):
        given_bytes(tmp_path / "sparse", most=1000)


def test_a_private_folder_is_of_this_user_alone(tmp_path: Path) -> None:
    folder = private_folder(tmp_path / "own")
    assert private_folder(folder).stat().st_mode & 0o777 == 0o700
    folder.chmod(0o750)
    with pytest.raises(ConfigError, match="others may write there"):
        private_folder(folder)
    (tmp_path / "link").symlink_to(private_folder(tmp_path / "third"))
    with pytest.raises(ConfigError, match="others may write there"):
        private_folder(tmp_path / "link")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be made"):
        private_folder(tmp_path / "file" / "below")
    if os.getuid() == 0:
        os.chown(folder, 65534, 65534)
        folder.chmod(0o700)
        with pytest.raises(ConfigError, match="others may write there"):
            private_folder(folder)


def test_a_folder_holds_files_and_folders_and_what_is_in_these_is_not_looked_at(tmp_path: Path) -> None:
    folder = tmp_path / "handed"
    (folder / "evidence").mkdir(parents=True)
    os.mkfifo(folder / "evidence" / "pipe")
    (folder / "evidence" / "out").symlink_to(tmp_path)
    (folder / "gone").symlink_to("nothing")  # as a file that another process has just removed
    (folder / "link").symlink_to("evidence")
    assert given_folder(folder) == folder
    assert given_folder(tmp_path / "none") == tmp_path / "none"
    for make in (lambda path: path.symlink_to(tmp_path), lambda path: path.symlink_to("/none"), os.mkfifo):
        make(folder / "bad")
        with pytest.raises(ConfigError):
            given_folder(folder)
        (folder / "bad").unlink()
