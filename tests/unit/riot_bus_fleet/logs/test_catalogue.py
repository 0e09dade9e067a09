from __future__ import annotations

import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_fleet.logs.catalogue import Catalogue, default_catalogue
from riot_bus_fleet.logs.entry import LATEST, LogEntry, TopicEntry
from riot_bus_fleet.logs.near_misses import FleetScan, LogScan, NearMiss
from riot_bus_fleet.logs.query import Query, parse_query

EVERYTHING = Query(condition="1")


def entry(place: str, **more: object) -> LogEntry:
    return LogEntry(**{"place": place, "size": 1, "stamp": "1", "robot": "r1", **more})  # type: ignore[arg-type]


def test_what_was_put_is_shown(tmp_path: Path) -> None:
    topics = (TopicEntry("/odom", "0/odom", "nav_msgs/msg/Odometry", "cdr", 7, 2), TopicEntry("x", "x", "", "json", 1))
    wanted = entry(
        "/logs/a.mcap", robot="r7", named_by="log", start=5, end=10**18, messages=8, lost=1, problem="cut",
        profile="ros2", topics=topics, metadata={"seed": "3"},
    )  # fmt: skip
    with Catalogue(tmp_path / "new" / "c.sqlite") as catalogue:
        catalogue.put(wanted)
    with Catalogue(tmp_path / "new" / "c.sqlite", create=False) as catalogue:
        found = catalogue.show("/logs/a.mcap")
        assert found == LogEntry(**{**{name: getattr(wanted, name) for name in wanted.__slots__}, "number": 1})
        (known,) = catalogue.find(Query())
        assert (known.topics, known.metadata, known.robot) == ((), {}, "r7")
        assert catalogue.known("/logs/b.mcap") is None


def test_a_log_that_has_changed_replaces_itself(tmp_path: Path) -> None:
    with Catalogue(tmp_path / "c.sqlite") as catalogue:
        catalogue.put(entry("/a.mcap", topics=(TopicEntry("t", "t", "", "", 1),), metadata={"a": "1"}))
        catalogue.put(entry("/a.mcap", size=2, topics=(TopicEntry("u", "u", "", "", 1),)))
        found = catalogue.show("1")
    assert [each.topic for each in found.topics] == ["u"]
    assert (found.size, found.metadata) == (2, {})


def test_logs_are_named_in_several_ways() -> None:
    with Catalogue(None) as catalogue:
        for place in ("/a/x.mcap", "/b/x.mcap", "s3://bucket/r7/y.mcap"):
            catalogue.put(entry(place))
        assert catalogue.show("s3://bucket/r7/y.mcap").number == 3
        assert catalogue.show("2").place == "/b/x.mcap"
        assert catalogue.show("y.mcap").place == catalogue.show("r7/y.mcap").place == "s3://bucket/r7/y.mcap"
        assert catalogue.show("b/x.mcap").number == 2
        with pytest.raises(ConfigError, match="could be several logs") as caught:
            catalogue.show("x.mcap")
        assert "/a/x.mcap" in (caught.value.hint or "")
        with pytest.raises(ConfigError, match="no log 'yy") as caught:
            catalogue.show("yy.mcap")
        assert "'y.mcap'" in (caught.value.hint or "")


def test_what_is_not_seen_is_gone_and_comes_back() -> None:
    with Catalogue(None) as catalogue:
        for place in ("/a/1.mcap", "/a/2.mcap", "/ab/3.mcap"):
            catalogue.put(entry(place))
        assert catalogue.mark_gone("/a", ["/a/1.mcap"]) == 1
        assert [each.place for each in catalogue.find(parse_query("gone"))] == ["/a/2.mcap"]
        assert [each.place for each in catalogue.find(Query())] == ["/a/1.mcap", "/ab/3.mcap"]
        catalogue.back("/a/2.mcap")
        assert catalogue.count(Query()) == 3
        assert catalogue.mark_gone("/ab", []) == 1
        assert catalogue.prune() == 1
        assert catalogue.count(EVERYTHING) == 2


def test_a_name_given_from_outside_does_not_replace_what_the_log_says() -> None:
    with Catalogue(None) as catalogue:
        catalogue.put(entry("/1.mcap", named_by="log"))
        catalogue.put(entry("/2.mcap"))
        for place in ("/1.mcap", "/2.mcap"):
            catalogue.name(place, "other")
        assert [each.robot for each in catalogue.find(Query())] == ["r1", "other"]


def test_hostile_values_are_kept_within_bounds() -> None:
    with Catalogue(None) as catalogue:
        catalogue.put(
            entry("/1.mcap", robot="r" * 10**6, start=2**64 - 1, end=2**70, messages=2**80, problem="\ud800\0'; DROP")
        )
        (found,) = catalogue.find(EVERYTHING)
    assert (len(found.robot), found.start, found.end, found.messages) == (4096, LATEST, LATEST, LATEST)
    assert found.problem == "?\0'; DROP"


def test_pages() -> None:
    with Catalogue(None) as catalogue:
        for number in range(5):
            catalogue.put(entry(f"/{number}.mcap", start=10 - number))
        assert [each.place for each in catalogue.find(Query(), limit=2, offset=1)] == ["/3.mcap", "/2.mcap"]


def test_what_is_no_catalogue_is_left_alone(tmp_path: Path) -> None:
    other = tmp_path / "other.sqlite"
    with sqlite3.connect(other) as db:
        db.execute("CREATE TABLE precious(x)")
    db.close()
    text = tmp_path / "text.sqlite"
    text.write_text("something else" * 1000)
    for path in (other, text):
        before = path.read_bytes()
        with pytest.raises(ConfigError, match="this is not a catalogue"):
            Catalogue(path)
        assert path.read_bytes() == before
    with pytest.raises(ConfigError, match="there is no catalogue yet"):
        Catalogue(tmp_path / "none.sqlite", create=False)
    with pytest.raises(ConfigError, match="cannot open the catalogue"):
        Catalogue(tmp_path)


def rows(path: Path, statement: str) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(path)) as db:
        return db.execute(statement).fetchall()


def test_scans_are_kept_by_log_and_rule(tmp_path: Path) -> None:
    path, stated = tmp_path / "c.sqlite", "SELECT log, rule, distance, holds, problem FROM scans ORDER BY rule, log"

    def scanned(rule: str, *distances: float) -> FleetScan:
        found = [
            LogScan(f"/{n}.mcap", judged=5, holds=int(far <= 0), nearest=(NearMiss(far, 7, {"x": far}),))
            for n, far in enumerate(distances)
        ]
        return FleetScan(rule, 1.0, (*found, LogScan("/broken.mcap", problem="no log"), LogScan("/unknown.mcap")))

    with Catalogue(path) as catalogue:
        for name in ("0", "1", "broken"):
            catalogue.put(entry(f"/{name}.mcap"))
        catalogue.put_scan(scanned("x > 1", 0.5, -1.0))
        catalogue.put_scan(scanned("y > 1", 3.0, 4.0))
        catalogue.put_scan(scanned("x > 1", 0.25, 2.0))
        assert rows(path, stated) == [
            (1, "x > 1", 0.25, 0, ""),
            (2, "x > 1", 2.0, 0, ""),
            (3, "x > 1", None, 0, "no log"),
            (1, "y > 1", 3.0, 0, ""),
            (2, "y > 1", 4.0, 0, ""),
            (3, "y > 1", None, 0, "no log"),
        ]
        moments = "SELECT log, rule, distance, time, told FROM moments ORDER BY rule, log"
        assert rows(path, moments)[0] == (1, "x > 1", 0.25, 7, "x = 0.25")
        catalogue.put(entry("/0.mcap"))  # it has changed: what was found of it is no longer so
        assert [row[0] for row in rows(path, stated)] == [2, 3, 2, 3]
        assert [row[0] for row in rows(path, moments)] == [2, 2]


def test_another_version_is_refused(tmp_path: Path) -> None:
    Catalogue(tmp_path / "c.sqlite").close()
    with sqlite3.connect(tmp_path / "c.sqlite") as db:
        db.execute("PRAGMA user_version = 99")
    db.close()
    with pytest.raises(ConfigError, match="version 99"):
        Catalogue(tmp_path / "c.sqlite")


def test_two_processes_and_several_threads_may_write(tmp_path: Path) -> None:
    path = tmp_path / "c.sqlite"
    with Catalogue(path) as one, Catalogue(path) as other:
        threads = [
            threading.Thread(target=lambda known=known, n=n: known.put(entry(f"/{n}.mcap")))  # type: ignore[misc]
            for n, known in enumerate([one, other] * 10)
        ]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
        assert one.count(Query()) == other.count(Query()) == 20


def test_a_catalogue_that_others_hold_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "c.sqlite"
    Catalogue(path).close()
    monkeypatch.setattr("riot_bus_fleet.logs.catalogue._BUSY_S", 0.01)
    with Catalogue(path) as known:
        holder = sqlite3.connect(path, isolation_level=None)
        holder.execute("BEGIN EXCLUSIVE")
        with pytest.raises(EnvironmentFaultError, match="locked"):
            known.put(entry("/1.mcap"))
        holder.execute("ROLLBACK")
        holder.close()
        known.put(entry("/1.mcap"))
        assert known.count(Query()) == 1


def test_the_default_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_catalogue() == tmp_path / "riot" / "catalogue.sqlite"
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_catalogue() == tmp_path / ".local/share/riot/catalogue.sqlite"
