from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session import wait_until
from riot_bus_fleet.agent.library import Library
from riot_bus_fleet.logs.index import IndexReport
from tests.log_mutants import chunk, statistics, whole
from tests.tiers import scaled
from tests.unit.riot_bus_fleet.logs.fleet_logs import write

_PARTS = ["..", ".", "up", "out.mcap", "a.mcap", "bag", "mixed", "", "~", "logs"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path / "outside.mcap", "a")
    root = tmp_path / "logs"
    write(root / "a.mcap", "a", count=3)
    write(root / "bag" / "bag_10.mcap", "a", count=3)
    write(root / "bag" / "bag_9.mcap", "a", count=3)
    (root / "empty").mkdir()
    (root / "notes.txt").write_text("x")
    (root / "out.mcap").symlink_to(tmp_path / "outside.mcap")
    (root / "up").symlink_to(tmp_path)
    (root / "in.mcap").symlink_to(root / "a.mcap")
    (root / "mixed").mkdir()
    (root / "mixed" / "x.mcap").symlink_to(tmp_path / "outside.mcap")
    os.mkfifo(root / "pipe.mcap")
    return root


@pytest.fixture
def library(folder: Path) -> Iterator[Library]:
    found = Library(folder, "r7")
    found.start()
    yield found
    found.close()


def look_at(library: Library) -> None:
    """Wait until a look has ended that begins now."""
    look = library.logs()["look"]
    assert wait_until(lambda: library.logs(look=look)["complete"], 30)


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("a.mcap", ["a.mcap"]),
        ("./bag/../a.mcap", ["a.mcap"]),
        ("in.mcap", ["a.mcap"]),
        ("bag", ["bag/bag_9.mcap", "bag/bag_10.mcap"]),
        ("bag/bag_10.mcap", ["bag/bag_10.mcap"]),
    ],
)
def test_what_is_inside_is_found(library: Library, folder: Path, name: str, files: list[str]) -> None:
    assert library.resolve(name) == [folder / each for each in files]
    assert library.resolve(str(folder / name)) == library.resolve(name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("../outside.mcap", "is outside of the folder"),
        ("/etc/passwd", "is outside of the folder"),
        ("out.mcap", "is outside of the folder"),
        ("up/outside.mcap", "is outside of the folder"),
        ("mixed", "leads out of the folder 'mixed'"),
        ("pipe.mcap", "is not a log"),
        ("notes.txt", "is not a log"),
        ("empty", "holds no .mcap files"),
        (".", "leads out of the folder 'logs'|no regular file"),
        ("", "is not a path"),
        ("a\0.mcap", "is not a path"),
        ("a\n.mcap", "is not a path"),
        ("x" * 1001, "is not a path"),
        ("none.mcap", "No such file"),
        ("x" * 300, "File name too long"),
    ],
)
def test_what_is_refused(library: Library, name: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        library.resolve(name)


def test_several_names(library: Library, folder: Path) -> None:
    assert library.resolve_all(["a.mcap", "bag"]) == [folder / "a.mcap", *library.resolve("bag")]
    with pytest.raises(ConfigError, match="502 logs at once are too many"):
        library.resolve_all(["bag"] * 251)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=scaled(200))
@given(
    st.lists(st.sampled_from(["..", ".", "up", "out.mcap", "a.mcap", "bag", "mixed", "", "~", "logs"]), max_size=6).map(
        "/".join
    )
    | st.text()
)
def test_no_name_leads_outside(library: Library, folder: Path, name: str) -> None:
    try:
        found = library.resolve(name)
    except ConfigError:
        return
    assert found
    assert all(each == each.resolve() and each.is_relative_to(folder) for each in found)


def test_logs_are_listed_and_asked_for(library: Library, folder: Path) -> None:
    look_at(library)
    rows = library.logs("path='*bag*'")["logs"]
    assert [(each["name"], each["messages"]) for each in rows] == [("bag/bag_10.mcap", 3), ("bag/bag_9.mcap", 3)]
    everything = library.logs()
    assert everything["count"] == len(everything["logs"])
    assert library.logs(limit=1)["logs"] == everything["logs"][:1]
    assert library.logs(limit=1, offset=1)["logs"] == everything["logs"][1:2]
    assert library.logs(limit=-5, offset=-5)["logs"] == []
    write(folder / "new.mcap", "b", count=4)
    assert wait_until(lambda: library.logs("topic=b")["count"] == 1, 30)
    (folder / "new.mcap").unlink()
    assert wait_until(lambda: library.logs("topic=b")["count"] == 0, 30)


def test_questions_do_not_wait_for_a_look(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    let_go = threading.Event()
    looks = []

    def index(*_: object, **__: object) -> IndexReport:
        looks.append(len(looks))
        let_go.wait(30)
        return IndexReport()

    monkeypatch.setattr("riot_bus_fleet.agent.library.index", index)
    library = Library(folder, "r7")
    library.start()
    answers = [library.logs() for _ in range(1000)]  # a second each would be a quarter of an hour
    assert not any(each["complete"] for each in answers)
    assert len(looks) <= 1
    let_go.set()
    assert wait_until(lambda: library.logs(look=answers[-1]["look"])["complete"], 30)
    assert len(looks) == 2, "the one that had begun, and one for all thousand questions"
    library.close()


def test_what_cannot_be_looked_at_is_said_once(folder: Path, tmp_path: Path) -> None:
    with open(os.fsencode(folder) + b"/\xff.mcap", "wb"):
        pass
    told: list[str] = []
    library = Library(folder, "r7", catalogue=tmp_path / "c.sqlite", failed=told.append)
    library.start()
    look_at(library)
    look_at(library)
    library.close()
    assert sorted(each.rpartition(": ")[2] for each in told) == [
        "the name is not UTF-8",
        "this is no regular file",
        "this link leads out of the folder 'logs'",
        "this link leads out of the folder 'logs'",
    ]
    library.close()


def test_a_hostile_log_is_named_and_takes_no_memory(tmp_path: Path) -> None:
    size = 64 << 20
    packed = zstandard.compress(bytes(size))
    zeros = chunk(b"", packed=packed, size=size, checksum=0, start=1, end=2)
    (tmp_path / "a.mcap").write_bytes(whole(zeros, summary=statistics(1, channels=0)))
    library = Library(tmp_path, "r7")
    library.start()
    try:
        look_at(library)
        (row,) = library.logs()["logs"]
        assert "more than ratio=200" in row["problem"]
        assert "RIOT_LOG_LIMITS=ratio=" in row["problem"]
    finally:
        library.close()
