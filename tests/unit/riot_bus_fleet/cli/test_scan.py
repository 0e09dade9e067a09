"""`riot scan`: exit codes, what it looks at, and its page."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner, Result

from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import RiotError
from tests.unit.riot_bus_fleet.test_scan import FAST, message, write_log, write_rule


def scan(*words: object) -> Result:
    return CliRunner().invoke(make_app("scan"), ["scan", *map(str, words)])


def code(done: Result) -> int:
    return done.exception.exit_code if isinstance(done.exception, RiotError) else done.exit_code


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    for robot, top in (("r1", 4), ("r2", 9.5), ("r3", 12)):
        speeds = [3, top, 3.5]
        write_log(tmp_path / "logs" / robot / "day.mcap", [message(2000 * n, "a", x=x) for n, x in enumerate(speeds)])
    write_rule(tmp_path / "rule", FAST, "a", a_x=1.0)
    return tmp_path


def test_robots_are_told_nearest_first(fleet: Path) -> None:
    done = scan(fleet / "logs", "--rule", fleet / "rule/rule.json", "--near", 1)
    assert done.exit_code == 1, done.output
    lines = done.stdout.splitlines()
    assert [line for line in lines if line.startswith("robot")] == ["robot r3", "robot r2", "robot r1"]
    assert "    2.000 s, 0.5 away: a:x = 9.5" in lines
    told = json.loads(scan(fleet / "logs/r2", "--rule", fleet / "rule/rule.json", "--format", "json").stdout)
    assert told["logs"][0]["nearest"][0] == {
        "distance": 0.5,
        "time": 10**18 + 2 * 10**9,
        "seconds": 2.0,
        "values": {"a:x": 9.5},
    }


def test_a_folder_with_a_rule_will_do_such_as_the_region_of_a_finding(fleet: Path) -> None:
    assert scan(fleet / "logs/r3", "--rule", fleet / "rule").exit_code == 1


def test_logs_of_a_catalogue_are_chosen_by_a_query(fleet: Path) -> None:
    known = fleet / "catalogue.sqlite"
    options = ("--catalogue", known, "--rule", fleet / "rule/rule.json")
    assert code(scan(*options)) == 2  # there is none yet
    indexed = CliRunner().invoke(make_app("fleet"), ["fleet", "index", str(fleet / "logs"), "--catalogue", str(known)])
    assert indexed.exit_code == 0, indexed.output
    assert scan(*options).exit_code == 1
    with closing(sqlite3.connect(known)) as db:
        kept = db.execute(
            "SELECT robot, distance, holds FROM scans JOIN logs ON number = log ORDER BY robot"
        ).fetchall()
        assert kept == [("r1", 6.0, 0), ("r2", 0.5, 0), ("r3", -2.0, 1)]
    done = scan(*options, "--over", "robot=r1")
    assert done.exit_code == 0, done.output
    assert "1 log: none meets the rule, 0 near misses" in done.stdout
    assert code(scan(*options, "--over", "robot=r7")) == 2


def test_where_nothing_can_be_judged_no_answer_is_given(fleet: Path) -> None:
    write_log(fleet / "other.mcap", [message(0, "b", x=1)])
    done = scan(fleet / "other.mcap", "--rule", fleet / "rule/rule.json")
    assert code(done) == 5
    assert "no topic 'a' in the log: 1 log" in done.stdout
    assert code(scan(fleet / "gone.mcap", "--rule", fleet / "rule/rule.json")) == 2
    assert code(scan(fleet / "other.mcap", "--rule", fleet / "gone")) == 2
    assert code(scan(fleet / "other.mcap", "--watch", "--rule", fleet / "rule/rule.json")) == 2


@pytest.mark.parametrize("words", [("--page", "x.html"), ("--over", "robot=r1"), ("--format", "json")])
def test_what_is_for_logs_is_refused_for_live_traffic(fleet: Path, words: tuple[str, str]) -> None:
    done = scan("--watch", "--rule", fleet / "rule/rule.json", *words)
    assert code(done) == 2
    assert words[0] in str(done.exception)


def test_the_page_shows_each_log_and_obeys_none(fleet: Path) -> None:
    write_log(fleet / "logs/r2/<script>x.mcap", [message(0, "b", x=1)])
    page = fleet / "fleet.html"
    assert scan(fleet / "logs", "--rule", fleet / "rule/rule.json", "--page", page).exit_code == 1
    text = page.read_text(encoding="utf-8")
    assert "<script" not in text
    assert text.count("<svg") == 3
    pictures = [ElementTree.fromstring(f"<svg{part.partition('</svg>')[0]}</svg>") for part in text.split("<svg")[1:]]
    lowest = [max(float(pair.split("H")[0].split()[-1]) for pair in _steps(one)) for one in pictures]
    assert lowest == sorted(lowest, reverse=True)  # the nearest log comes first, and what is near is low
    assert lowest[0] == pytest.approx(float(pictures[0][0].attrib["d"].split("H")[0].split()[-1]), abs=0.1)


def _steps(picture: ElementTree.Element) -> list[str]:
    return [part for part in picture[2].attrib["d"].replace("L", "M").split("M") if part]
