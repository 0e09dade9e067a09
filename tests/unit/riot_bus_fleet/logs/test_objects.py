from __future__ import annotations

import sys
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.info import log_info
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, MissingExtraError
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.index import index
from riot_bus_fleet.logs.objects import ObjectStore
from riot_bus_fleet.logs.query import Query
from riot_bus_fleet.logs.stores import copied
from tests.unit.riot_bus_fleet.logs.fleet_logs import write

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def bucket() -> Iterator[str]:
    """The URL of an object store that is in memory."""
    url = f"memory:///{uuid.uuid4().hex}/logs"
    fsspec.filesystem("memory").makedirs(url)
    yield url
    fsspec.filesystem("memory").rm(url, recursive=True)


def upload(url: str, path: Path) -> None:
    fsspec.filesystem("memory").put_file(str(path), url)


def large(path: Path) -> Path:
    """A log that is larger than a block; what is in it cannot be compressed."""
    import random

    from riot_bus.log.writer import LogWriter
    from riot_bus.vocabulary.message import Message

    path.parent.mkdir(parents=True, exist_ok=True)
    draw = random.Random(1)
    with LogWriter(path, metadata={"robot": "r7"}) as writer:
        for number in range(60):
            writer.write(Message(10**18 + number, "a", draw.randbytes(100_000), sequence=number))
    return path


def test_an_object_store_is_indexed(tmp_path: Path, bucket: str) -> None:
    upload(f"{bucket}/r1/day/a.mcap", write(tmp_path / "a.mcap", "odom"))
    upload(f"{bucket}/r2/b.mcap", large(tmp_path / "b.mcap"))
    upload(f"{bucket}/r2/c.txt", tmp_path / "a.mcap")
    (tmp_path / "d.mcap").write_text("no log")
    upload(f"{bucket}/d.mcap", tmp_path / "d.mcap")
    with Catalogue(None) as catalogue:
        report = index(catalogue, [bucket])
        assert (report.logs, report.fresh, report.damaged, report.failures) == (3, 3, 1, [])
        found = {each.place.removeprefix(f"{bucket}/"): each for each in catalogue.find(Query())}
        assert {name: (each.robot, each.messages, each.problem) for name, each in found.items()} == {
            "r1/day/a.mcap": ("r1", 11, ""),
            "r2/b.mcap": ("r7", 60, ""),
            "d.mcap": ("logs", 0, "not an MCAP file"),
        }
        assert index(catalogue, [bucket]).fresh == 0
        fsspec.filesystem("memory").rm(f"{bucket}/r1/day/a.mcap")
        upload(f"{bucket}/r2/b.mcap", tmp_path / "a.mcap")
        report = index(catalogue, [bucket])
        assert (report.fresh, report.gone) == (1, 1)


def test_a_single_object(tmp_path: Path, bucket: str) -> None:
    upload(f"{bucket}/r1/a.mcap", write(tmp_path / "a.mcap", "odom"))
    with Catalogue(None) as catalogue:
        assert index(catalogue, [f"{bucket}/r1/a.mcap"]).fresh == 1
        assert catalogue.show("a.mcap").robot == "r1"
    with copied(f"{bucket}/r1/a.mcap") as path:
        assert path.read_bytes() == (tmp_path / "a.mcap").read_bytes()
    assert not path.exists()


def test_logs_within_archives_are_found_again(tmp_path: Path) -> None:
    import zipfile

    log = write(tmp_path / "a.mcap", "odom")
    for name in ("one", "two"):
        with zipfile.ZipFile(tmp_path / f"{name}.zip", "w") as archive:
            archive.write(log, "r1/a.mcap")
    urls = [f"zip://::file://{tmp_path}/{name}.zip" for name in ("one", "two")]
    with Catalogue(None) as catalogue:
        assert index(catalogue, urls).fresh == 2
        assert index(catalogue, urls).fresh == 0
        places = sorted(each.place for each in catalogue.find(Query()))
        assert {each.robot for each in catalogue.find(Query())} == {"r1"}
    assert places == [f"zip://r1/a.mcap::file://{tmp_path}/{name}.zip" for name in ("one", "two")]
    with copied(places[1]) as path:
        assert path.read_bytes() == log.read_bytes()


def test_of_a_large_log_the_ends_are_fetched(tmp_path: Path, bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    log = large(tmp_path / "a.mcap")
    upload(f"{bucket}/a.mcap", log)
    store = ObjectStore(bucket)
    fetched = 0
    original = store._fs.cat_file

    def cat_file(path: str, start: int, end: int, **more: Any) -> bytes:
        nonlocal fetched
        fetched += end - start
        return bytes(original(path, start=start, end=end, **more))

    monkeypatch.setattr(store._fs, "cat_file", cat_file)
    (found,) = store.logs(pytest.fail)
    with store.excerpt(found) as path:
        assert path.stat().st_size == log.stat().st_size > 6_000_000
        summary = path.read_bytes()[-300:]
        info = log_info(path, scan=False)
    assert summary == log.read_bytes()[-300:]
    assert fetched < 200_000
    assert (info.scanned, info.count, info.metadata["robot"]) == (False, 60, "r7")


def test_of_a_large_log_without_summary_all_is_fetched(tmp_path: Path, bucket: str) -> None:
    data = large(tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(data[: len(data) * 9 // 10])
    upload(f"{bucket}/a.mcap", tmp_path / "a.mcap")
    with Catalogue(None) as catalogue:
        index(catalogue, [bucket])
        (found,) = catalogue.find(Query())
    assert "the file was not closed" in found.problem
    assert 40 < found.messages < 60


def test_what_cannot_be_opened(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="this place cannot be opened"):
        ObjectStore("nonsense://x")
    failures: list[str] = []
    assert list(ObjectStore(f"{bucket}/none").logs(failures.append)) == []
    assert failures == [f"{bucket}/none: there is nothing"]
    fsspec.filesystem("memory").touch(f"{bucket}/x")
    with pytest.raises(ConfigError, match="there is nothing"), copied(f"{bucket}/none.mcap"):
        pass
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(MissingExtraError, match="\\[fleet\\]"):
        ObjectStore(bucket)


def test_a_store_that_fails_meanwhile(tmp_path: Path, bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    upload(f"{bucket}/a.mcap", large(tmp_path / "a.mcap"))
    upload(f"{bucket}/b.mcap", write(tmp_path / "b.mcap", "x"))
    store = ObjectStore(bucket)
    a, b = sorted(store.logs(pytest.fail), key=lambda each: each.place)

    def fail(*_: Any, **__: Any) -> bytes:
        raise TimeoutError("no answer")

    with monkeypatch.context() as patch:
        patch.setattr(store._fs, "cat_file", fail)
        with pytest.raises(EnvironmentFaultError, match="TimeoutError: no answer"), store.excerpt(a):
            pass
        patch.setattr(store._fs, "cat_file", lambda *_, **__: b"short")
        with pytest.raises(EnvironmentFaultError, match="5 bytes came"), store.excerpt(a):
            pass
        patch.setattr(store._fs, "get_file", fail)
        with pytest.raises(EnvironmentFaultError, match="TimeoutError: no answer"), store.whole(b):
            pass
        with Catalogue(None) as catalogue:
            report = index(catalogue, [bucket])
            assert (report.logs, report.fresh, len(report.failures)) == (2, 0, 2)
