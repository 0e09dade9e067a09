from __future__ import annotations

import os
from pathlib import Path

import pytest

from riot_bus.log.account import LOST, Account
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.index import index
from riot_bus_fleet.logs.query import Query, parse_query
from tests.unit.riot_bus_fleet.logs.fleet_logs import BEGIN, SECOND, write


def test_folders_are_indexed(tmp_path: Path) -> None:
    write(tmp_path / "r1" / "day" / "a.mcap", "odom", "scan", seed="5")
    write(tmp_path / "r2" / "b.mcap", "odom", begin=BEGIN + 100 * SECOND)
    write(tmp_path / "c.mcap", "x", robot="r9")
    (tmp_path / "r1" / "notes.txt").write_text("no log")
    with Catalogue(None) as catalogue:
        report = index(catalogue, [str(tmp_path)])
        assert (report.logs, report.fresh, report.damaged, report.gone, report.failures) == (3, 3, 0, 0, [])
        named = {Path(each.place).name: (each.robot, each.named_by) for each in catalogue.find(Query())}
        assert named == {"a.mcap": ("r1", "folder"), "b.mcap": ("r2", "folder"), "c.mcap": ("r9", "log")}
        found = catalogue.show("a.mcap")
        assert (found.messages, found.seconds, found.start, found.problem) == (22, 10.0, BEGIN, "")
        assert [(each.topic, each.count) for each in found.topics] == [("odom", 11), ("scan", 11)]
        assert found.metadata["seed"] == "5"


def test_only_what_is_new_or_has_changed_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import riot_bus_fleet.logs.index as module

    read: list[str] = []
    original = module.log_info

    def log_info(path: Path, **more: bool) -> object:
        read.append(path.name)
        return original(path, **more)

    monkeypatch.setattr(module, "log_info", log_info)
    one, two = write(tmp_path / "1.mcap", "a"), write(tmp_path / "2.mcap", "a")
    with Catalogue(None) as catalogue:
        index(catalogue, [str(tmp_path)], jobs=1)
        assert sorted(set(read)) == ["1.mcap", "2.mcap"]
        read.clear()
        assert index(catalogue, [str(tmp_path)]).fresh == 0
        assert read == []
        write(one, "a", "b")
        assert index(catalogue, [str(tmp_path)]).fresh == 1
        assert set(read) == {"1.mcap"}
        assert catalogue.show("1.mcap").messages == 22
        two.unlink()
        report = index(catalogue, [str(tmp_path)])
        assert (report.logs, report.gone) == (1, 1)
        read.clear()
        write(two, "a")
        os.utime(two, ns=(0, 1))
        index(catalogue, [str(tmp_path)])
        assert catalogue.count(Query()) == 2
        two.unlink()
        assert index(catalogue, [str(tmp_path)], prune=True).pruned == 1


def test_damaged_logs_are_listed_with_what_is_wrong(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.mcap", "a", count=2000).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.mcap").write_text("hello")
    (tmp_path / "empty.mcap").touch()
    with Catalogue(None) as catalogue:
        report = index(catalogue, [str(tmp_path)])
        assert (report.logs, report.damaged, report.failures) == (4, 3, [])
        found = {Path(each.place).name: each for each in catalogue.find(Query())}
        assert found["whole.mcap"].problem == ""
        assert found["cut.mcap"].readable
        assert "the file was not closed" in found["cut.mcap"].problem
        assert (found["text.mcap"].readable, found["text.mcap"].problem) == (False, "not an MCAP file")
        assert (found["empty.mcap"].readable, found["empty.mcap"].problem) == (False, "the file is empty")
        assert catalogue.count(parse_query("damaged")) == 3
        assert index(catalogue, [str(tmp_path)]).fresh == 0


def test_damage_that_the_summary_does_not_know_of_is_found_on_demand(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", "a", count=5000)
    data = bytearray(path.read_bytes())
    middle = len(data) // 3
    data[middle : middle + 8] = bytes(each ^ 0xFF for each in data[middle : middle + 8])
    path.write_bytes(data)
    with Catalogue(None) as catalogue:
        index(catalogue, [str(tmp_path)])
        assert catalogue.show("a.mcap").problem == ""
        assert index(catalogue, [str(tmp_path)], scan=True).fresh == 1  # though it has not changed
        assert "damaged chunk" in catalogue.show("a.mcap").problem
        assert index(catalogue, [str(tmp_path)], scan=True).fresh == 0
    with Catalogue(None) as catalogue:
        assert index(catalogue, [str(tmp_path)], scan=True).fresh == 1
        assert "damaged chunk" in catalogue.show("a.mcap").problem


def test_what_a_recorder_lost_counts(tmp_path: Path) -> None:
    account = Account({"a": 1}, {"disk": {"a": 7, "b": 2}, "missed": {"a": 1}})
    with LogWriter(tmp_path / "a.mcap") as writer:
        writer.write(Message(BEGIN, "a", b"x"))
        writer.note(LOST, account.record())
    with Catalogue(None) as catalogue:
        report = index(catalogue, [str(tmp_path)])
        found = catalogue.show("a.mcap")
        assert (found.messages, found.lost, report.damaged) == (1, 10, 1)
        assert found.problem == "10 messages were lost while it was recorded"
        assert catalogue.count(parse_query("lossless")) == 0


def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    for number in range(12):
        write(tmp_path / f"{number}.mcap", "a", count=2)
    seen: list[str] = []

    def interrupt(done: int, place: str) -> None:
        seen.append(place)
        if done == 8:
            raise KeyboardInterrupt

    with Catalogue(tmp_path / "c.sqlite") as catalogue, pytest.raises(KeyboardInterrupt):
        index(catalogue, [str(tmp_path)], jobs=1, progress=interrupt)
    with Catalogue(tmp_path / "c.sqlite") as catalogue:
        done = catalogue.count(Query())
        assert 0 < done < 12
        report = index(catalogue, [str(tmp_path)])
        assert (report.logs, report.fresh) == (12, 12 - done)


def test_a_run_that_is_told_to_stop_calls_nothing_gone(tmp_path: Path) -> None:
    for number in range(5):
        write(tmp_path / f"{number}.mcap", "a", count=2)
    with Catalogue(None) as catalogue:
        index(catalogue, [str(tmp_path)])
        asked = iter([False, False, True, True, True])
        assert index(catalogue, [str(tmp_path)], stop=lambda: next(asked)).gone == 0


def test_a_folder_that_cannot_be_read_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "sub" / "1.mcap", "a")
    with Catalogue(None) as catalogue:
        index(catalogue, [str(tmp_path)])
        scandir = os.scandir

        def broken(path: str) -> object:
            if path.endswith("sub"):
                raise PermissionError(13, "Permission denied")
            return scandir(path)

        monkeypatch.setattr("riot_bus_fleet.logs.stores.os.scandir", broken)
        report = index(catalogue, [str(tmp_path)])
        assert report.failures == [f"{tmp_path / 'sub'}: Permission denied"]
        assert (report.gone, catalogue.count(Query())) == (0, 1)


def test_links_and_strange_files(tmp_path: Path) -> None:
    log = write(tmp_path / "elsewhere" / "1.mcap", "a")
    root = tmp_path / "root"
    root.mkdir()
    write(root / "a.mcap", "a")
    (root / "link.mcap").symlink_to(root / "a.mcap")
    (root / "out.mcap").symlink_to(log)
    (root / "loop").symlink_to(root)
    (root / "dangling.mcap").symlink_to(root / "nothing")
    os.mkfifo(root / "pipe.mcap")
    (root / "folder.mcap").mkdir()
    with open(os.fsencode(root) + b"/\xff.mcap", "wb"):
        pass
    with Catalogue(None) as catalogue:
        report = index(catalogue, [str(root)])
        assert [Path(each.place).name for each in catalogue.find(Query())] == ["a.mcap", "link.mcap"]
    assert sorted(each.rpartition(":")[2] for each in report.failures) == [
        " No such file or directory",
        " the name is not UTF-8",
        " this is no regular file",
        " this link leads out of the folder 'root'",
    ]


def test_what_is_refused_keeps_no_log_in_the_catalogue(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", "a")
    os.mkfifo(tmp_path / "pipe.mcap")
    with Catalogue(None) as catalogue:
        assert len(index(catalogue, [str(tmp_path)]).failures) == 1
        (tmp_path / "a.mcap").unlink()
        report = index(catalogue, [str(tmp_path)])
    assert (report.gone, len(report.failures)) == (1, 1)


def test_a_robot_may_be_given(tmp_path: Path) -> None:
    write(tmp_path / "1.mcap", "a")
    write(tmp_path / "2.mcap", "a", robot="r9")
    with Catalogue(None) as catalogue:
        index(catalogue, [str(tmp_path)])
        report = index(catalogue, [str(tmp_path)], robot="r7")
        assert report.fresh == 0
        assert [each.robot for each in catalogue.find(Query())] == ["r7", "r9"]
        index(catalogue, [f"file://{tmp_path}/1.mcap"], robot="r8")
        assert [each.robot for each in catalogue.find(Query())] == ["r8", "r9"]


def test_a_missing_folder_is_said(tmp_path: Path) -> None:
    with Catalogue(None) as catalogue, pytest.raises(ConfigError, match="there is no such folder"):
        index(catalogue, [str(tmp_path / "none")])
