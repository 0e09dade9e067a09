"""The queries that are shipped for Datasette answer rightly on a catalogue as it is today."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.index import index
from riot_bus_fleet.logs.near_misses import FleetScan, LogScan, NearMiss

SHIPPED = Path(__file__).resolve().parents[4] / "deploy/datasette/datasette.json"


def answers(path: Path) -> dict[str, list[dict[str, Any]]]:
    (queries,) = [each["queries"] for each in json.loads(SHIPPED.read_text())["databases"].values()]
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        db.row_factory = sqlite3.Row
        return {name: [dict(row) for row in db.execute(each["sql"])] for name, each in queries.items()}


def test_each_query_answers(tmp_path: Path) -> None:
    for robot, topics in (("r1", "ab"), ("r2", "a")):
        for number in range(2):
            (tmp_path / "logs" / robot).mkdir(parents=True, exist_ok=True)
            with LogWriter(tmp_path / f"logs/{robot}/{number}.mcap") as log:
                for step in range(11):
                    for topic in topics[: 1 if number else 2]:
                        log.write(Message(10**18 + step * 10**9, topic, b'{"x": 1}', encoding="application/json"))
    (tmp_path / "logs/r2/broken.mcap").write_bytes(b"no log")
    with Catalogue(tmp_path / "catalogue.sqlite") as known:
        index(known, [str(tmp_path / "logs")])
        first, second = (str(tmp_path / f"logs/r1/{number}.mcap") for number in range(2))
        near = NearMiss(0.25, 10**18 + 2 * 10**9, {"x": 1})
        scans = LogScan(first, problem="no topic 'x'"), LogScan(second, judged=11, nearest=(near,))
        known.put_scan(FleetScan("x > 1", 1.0, scans))
    found = answers(tmp_path / "catalogue.sqlite")
    assert {row["robot"]: (row["logs"], row["messages"], row["unreadable"]) for row in found["robots"]} == {
        "r1": (2, 33, 0),
        "r2": (3, 22, 1),
    }
    assert [Path(row["place"]).name for row in found["damaged"]] == ["broken.mcap"]
    assert [(row["topic"], row["logs"], row["robots"], row["per_second"]) for row in found["topics"]] == [
        ("a", 4, 2, 1.1),
        ("b", 1, 1, 1.1),
    ]
    assert [(Path(row["place"]).name, row["topic"]) for row in found["lacking"]] == [("1.mcap", "b")]
    assert {row["robot"]: row["logs"] for row in found["days"]} == {"r1": 2, "r2": 2}
    assert found["interceptors"] == []
    assert [(row["rule"], row["distance"], row["judged"]) for row in found["near_misses"]] == [("x > 1", 0.25, 11)]
    (moment,) = found["moments"]
    assert (moment["robot"], moment["seconds"], moment["told"]) == ("r1", 2.0, "x = 1")
