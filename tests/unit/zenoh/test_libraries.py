"""Copies of Zenoh's library: what they share, and what not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import zenoh

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh import libraries
from riot_bus.zenoh.libraries import borrow, give_back, library_of, moved

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType


@pytest.fixture
def pair() -> Iterator[tuple[Any, Any]]:
    both = borrow(), borrow()
    yield both
    for each in both:
        give_back(each)


def opened(library: Any) -> Any:
    config = library.Config()
    settings = {
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return library.open(config)


def test_nobody_else_has_a_borrowed_copy(pair: tuple[ModuleType, ModuleType]) -> None:
    assert pair[0] is not pair[1]
    assert zenoh not in pair
    third = borrow()
    assert third not in pair
    give_back(third)
    assert borrow() is third
    give_back(third)


def test_things_are_of_the_copy_that_made_them(pair: tuple[Any, Any]) -> None:
    for library in (*pair, zenoh):
        with opened(library) as session:
            assert library_of(session) is library
            assert library_of(session.new_timestamp()) is library
            publisher = session.declare_publisher("a")
            assert library_of(publisher) is library
            advanced = library.ext.declare_advanced_publisher(session, "b", cache=library.ext.CacheConfig(1))
            advanced.put("1")
    assert library_of(5) is zenoh
    with opened(pair[0]) as session, pytest.raises(ValueError, match="Invalid handler"):
        session.declare_subscriber("a", pair[1].handlers.FifoChannel(1))


def test_zenoh_itself_stays_what_it_was(pair: tuple[ModuleType, ModuleType]) -> None:
    for name in ("zenoh", "zenoh.zenoh", "zenoh.handlers", "zenoh.ext"):
        __import__(name)
        assert sys.modules[name] not in {*pair, *(each.handlers for each in pair), *(each.ext for each in pair)}
    assert zenoh.handlers is sys.modules["zenoh.handlers"]
    assert isinstance(zenoh.KeyExpr("a/b"), zenoh.KeyExpr)


def test_timestamps_keep_their_time_and_their_source(pair: tuple[Any, Any]) -> None:
    with opened(pair[0]) as session:
        for stamp in [session.new_timestamp() for _ in range(1000)]:
            other = moved(stamp, pair[1])
            assert type(other) is pair[1].Timestamp
            assert bytes(other.get_id()) == bytes(stamp.get_id())
            assert 0 <= stamp.get_time_as_ntp64().as_nanos() - other.get_time_as_ntp64().as_nanos() <= 1
            assert moved(stamp, pair[0]) is stamp
    assert moved(None, pair[0]) is None


def kept(original: Path, number: int) -> bytes:
    """What would be loaded."""
    file = libraries._kept(original, number)
    try:
        return os.pread(file, os.fstat(file).st_size, 0)
    finally:
        os.close(file)


def test_copies_are_kept_where_nobody_else_may_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    original = Path(sys.modules["zenoh.zenoh"].__file__ or "")
    path = libraries._place(original, 3)
    assert kept(original, 3) == original.read_bytes()
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert {each.name for each in path.parent.iterdir()} == {path.name, path.with_suffix(".checked").name}
    before = path.stat()
    assert kept(original, 3) == original.read_bytes()
    assert path.stat().st_mtime_ns == before.st_mtime_ns  # it is not made again
    path.chmod(0o777)
    with pytest.raises(PermissionError, match="others may write"):
        libraries._kept(original, 3)
    path.chmod(0o700)
    path.write_bytes(b"cut off")
    assert kept(original, 3) == original.read_bytes()
    assert {each.name for each in path.parent.iterdir()} == {path.name, path.with_suffix(".checked").name}


def test_one_wrong_byte_in_a_copy_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    original = Path(sys.modules["zenoh.zenoh"].__file__ or "")
    os.close(libraries._kept(original, 0))
    path = libraries._place(original, 0)
    path.chmod(0o700)
    with path.open("r+b") as file:
        file.seek(5_000_000)
        wrong = bytes([file.read(1)[0] ^ 1])
        file.seek(5_000_000)
        file.write(wrong)
    assert kept(original, 0) == original.read_bytes()


def test_what_is_loaded_is_what_was_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    original = Path(sys.modules["zenoh.zenoh"].__file__ or "")
    file = libraries._kept(original, 0)
    path = libraries._place(original, 0)
    path.unlink()
    path.write_bytes(b"something else")
    assert libraries._loaded(file, zenoh).Session is not zenoh.Session
    path.unlink()
    (tmp_path / "elsewhere").write_bytes(original.read_bytes())
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic links"):
        libraries._kept(original, 0)


def test_content_is_checked_once_for_each_state_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    original = Path(sys.modules["zenoh.zenoh"].__file__ or "")
    checked: list[int] = []
    hashed = libraries._hashed
    monkeypatch.setattr(libraries, "_hashed", lambda file: checked.append(file) or hashed(file))
    for _ in range(3):
        assert kept(original, 0) == original.read_bytes()
    assert len(checked) == 1
    path = libraries._place(original, 0)
    state = path.stat()
    path.chmod(0o700)
    with path.open("r+b") as file:
        file.write(b"!")
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))  # nobody can do that to the time of the change
    assert kept(original, 0) == original.read_bytes()
    path.with_suffix(".checked").write_bytes(b"\xff")
    assert kept(original, 0) == original.read_bytes()
    assert len(checked) == 4  # the wrong one, the one that took its place, and that again


def test_builds_are_told_by_their_wheels_checksum_or_by_their_time(tmp_path: Path) -> None:
    library = tmp_path / "zenoh" / "zenoh.abi3.so"
    library.parent.mkdir()
    library.write_bytes(b"1")
    assert libraries._digest(library) == "a4ayc_80_OGda4BO_1o_V0etpOqiLx1JwB5S3beHW0s"
    assert libraries._build(library) == str(library.stat().st_mtime_ns)
    wheel = tmp_path / "eclipse_zenoh-1.10.2.dist-info"
    wheel.mkdir()
    (wheel / "RECORD").write_text(
        "zenoh/ext.py,sha256=other,1\nzenoh/zenoh.abi3.so,sha256=zlC9dOHWBVVIXOAezufs-rest,1\n"
    )
    assert libraries._build(library) == "zlC9dOHWBVVIXOAezufs"
    assert libraries._digest(library) == "zlC9dOHWBVVIXOAezufs-rest"


_IN_MEMORY = """
import pathlib, sys, zenoh
from riot_bus.zenoh.libraries import borrow

def homeless(cls):
    raise RuntimeError("Could not determine home directory.")

if "none" in sys.argv:
    pathlib.Path.home = classmethod(homeless)
one, other = borrow(), borrow()
assert len({one.Session, other.Session, zenoh.Session}) == 3
assert "memfd:" in open("/proc/self/maps").read()
"""


@pytest.mark.parametrize("home", ["file", "none"])
def test_without_a_place_for_them_copies_are_in_memory(tmp_path: Path, home: str) -> None:
    (tmp_path / "file").write_text("no folder")
    environment = {"XDG_CACHE_HOME": str(tmp_path / "file") if home == "file" else "", "PATH": ""}
    subprocess.run([sys.executable, "-c", _IN_MEMORY, home], env=environment, check=True, timeout=60)


def test_what_cannot_be_loaded_is_a_fault_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> Path:
        raise OSError("the disk is full")

    monkeypatch.setattr(libraries, "_kept", refuse)
    monkeypatch.setattr(libraries, "_in_memory", refuse)
    with pytest.raises(EnvironmentFaultError, match="the disk is full"):
        libraries._load(99)
