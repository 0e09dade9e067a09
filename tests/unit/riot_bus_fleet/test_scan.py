"""How near logs come to a rule, against the rule asked at each message."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.chain.unit.prediction import predict
from riot_bus.findings.records import ProportionRecord, RuleRecord
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import FAR, Literal
from riot_bus.generalize.rule import Rule
from riot_bus.log.reader import read_log
from riot_bus.log.writer import LogWriter
from riot_bus.types.latest import LatestFields
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.index import index
from riot_bus_fleet.logs.near_misses import BINS
from riot_bus_fleet.logs.query import Query
from riot_bus_fleet.scan import Scanner, ScanRule, scan_logs

SURE = ProportionRecord(value=1, low=0.9, high=1, count=9, total=9)
FAST = Rule(((Literal(Feature("raw", ("a:x",)), ">", 10),),))


def message(milliseconds: int, topic: str, **values: object) -> Message:
    return Message(10**18 + milliseconds * 10**6, topic, json.dumps(values).encode(), encoding="application/json")


def write_log(path: Path, messages: Sequence[Message]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with LogWriter(path) as log:
        for each in messages:
            log.write(each)
    return path


def write_rule(folder: Path, rule: Rule, *topics: str, keeps: bool = False, **scale: float) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    RuleRecord(
        text=rule.text(),
        rule=rule.to_dict(),
        precision=SURE,
        recall=SURE,
        balanced_accuracy=1,
        scale={name.replace("_", ":"): spread for name, spread in scale.items()},
        topics=topics,
        keeps=keeps,
    ).save(folder)
    return folder


ABOVE = Literal(Feature("raw", ("b:y",)), ">", 2)
RULES = [
    (Rule(((Literal(Feature("sub", ("a:x", "b:y")), ">", 5),),)), ("a", "b")),
    (
        Rule(((Literal(Feature("sub", ("a[1]:x", "a[0]:x")), "<", -3), Literal(Feature("raw", ("b:y",)), ">", 2)),)),
        "aab",
    ),
    (Rule(((Literal(Feature("raw", ("a:mode",)), "==", "go"), Literal(Feature("raw", ("a:x",)), ">", 7)),)), ("a",)),
    (Rule(((Literal(Feature("raw", ("a:max(list[*])",)), ">", 8),),)), ("a",)),
    (Rule(((Literal(Feature("raw", ("a before b",)), "==", True),),)), ("a", "b")),
]


@pytest.mark.parametrize(("rule", "topics"), RULES, ids=range(len(RULES)))
@pytest.mark.parametrize("seed", range(3))
def test_a_scan_says_what_the_rule_says_at_each_message(
    tmp_path: Path, rule: Rule, topics: Sequence[str], seed: int
) -> None:
    draw = random.Random(seed)
    log = []
    for number in range(400):
        if draw.random() < 0.5:
            values = {"x": draw.choice([draw.randint(-9, 9), draw.uniform(-9, 9)]), "mode": draw.choice(["go", "stay"])}
            values |= {"list": [draw.randint(0, 9) for _ in range(draw.randint(1, 4))]}
            dropped = draw.choice(["x", "mode", "none", "none"])
            log.append(message(number, "a", **{name: value for name, value in values.items() if name != dropped}))
        else:
            log.append(message(number, "b", y=draw.randint(-9, 9)))
    path = write_log(tmp_path / "log.mcap", log)
    found = Scanner(ScanRule(write_rule(tmp_path / "rule", rule, *topics)), near=1000).scan(path)
    told = predict(rule, topics, read_log(path), registry=TypeRegistry(), at_most=1000)
    latest = LatestFields(rule.variables, topics, registry=TypeRegistry())
    values = [taken for each in read_log(path) if (taken := latest.take(each)) is not None]
    assert found.judged == sum(len(taken) == len(rule.variables) for taken in values)
    assert found.holds == told.fails
    assert found.unknown >= told.unknown  # a distance needs all fields
    assert found.problem == ""
    assert (found.distance <= 0) == (told.fails > 0)


@pytest.mark.parametrize("keeps", [False, True])
def test_a_message_without_a_field_may_leave_the_earlier_value_in_force(tmp_path: Path, *, keeps: bool) -> None:
    path = write_log(tmp_path / "log.mcap", [message(0, "a", x=11, y=0), message(10, "a", y=9), message(20, "a", x=1)])
    both = Rule(((Literal(Feature("raw", ("a:x",)), ">", 10), Literal(Feature("raw", ("a:y",)), ">", 5)),))
    found = Scanner(ScanRule(write_rule(tmp_path / "rule", both, "a", keeps=keeps))).scan(path)
    assert (found.judged, found.unknown, found.holds) == ((3, 0, 1) if keeps else (1, 2, 0))


def test_moments_are_the_least_and_a_second_apart(tmp_path: Path) -> None:
    speeds = [
        4.0 + 5 * math.exp(-(((n - 300) / 40) ** 2)) + 3 * math.exp(-(((n - 800) / 10) ** 2)) for n in range(1000)
    ]
    path = write_log(tmp_path / "log.mcap", [message(10 * n, "a", x=x) for n, x in enumerate(speeds)])
    found = Scanner(ScanRule(write_rule(tmp_path / "rule", FAST, "a", a_x=0.5))).scan(path)
    first, second, third = found.nearest
    assert (first.time - found.start) / 1e9 == pytest.approx(3.0)
    assert first.values == {"a:x": pytest.approx(9.0)}
    assert first.distance == pytest.approx(2.0)
    assert min(abs(one.time - other.time) for one, other in [(first, second), (first, third), (second, third)]) >= 1e9
    assert (found.holds, len(found.profile)) == (0, BINS)
    assert min(found.profile) == pytest.approx(2.0)
    assert first.words(found.start) == "3.000 s, 2 away: a:x = 9.0"


def test_a_hundred_logs_come_in_the_order_of_their_near_misses_and_no_other_is_one(tmp_path: Path) -> None:
    draw = random.Random(7)
    planted = {number: 9.99 - 0.06 * rank for rank, number in enumerate(draw.sample(range(100), 12))}
    for number in range(100):
        speeds = [draw.gauss(4, 1) for _ in range(300)]
        speeds = [min(speed, 8.5) for speed in speeds]
        if number in planted:
            speeds[draw.randrange(300)] = planted[number]
        log = [message(100 * n, "a", x=x) for n, x in enumerate(speeds)]
        write_log(tmp_path / f"logs/r{number % 5}/{number}.mcap", log)
    write_log(tmp_path / "logs/r9/other.mcap", [message(0, "b", x=99)])
    (tmp_path / "logs/r9/broken.mcap").write_bytes(b"no log")
    with Catalogue(None) as known:
        index(known, [str(tmp_path / "logs")])
        logs = known.find(Query())
    told: list[tuple[int, int]] = []
    found = scan_logs(
        write_rule(tmp_path / "rule", FAST, "a", a_x=1.0),
        logs,
        progress=lambda done, total, _: told.append((done, total)),
    )
    assert [Path(log.place).stem for log in found.near] == [str(number) for number in planted]
    assert not found.failing
    assert {Path(log.place).stem for log in found.unjudged} == {"other", "broken"}
    assert [robot for robot, _ in found.robots] == list(dict.fromkeys(f"r{number % 5}" for number in planted))
    assert told[-1] == (102, 102)
    assert found.summary() == (
        "102 logs: none meets the rule, 12 near misses (nearer than 1 nominal spread of its fields), 88 farther "
        "away, 2 not judged"
    )
    lines = found.lines()
    assert lines[0] == "rule: a:x > 10"
    assert lines.count("not judged") == 1
    assert "  no topic 'a' in the log: 1 log" in lines


def test_a_log_without_the_fields_together_is_not_judged_and_a_categorical_rule_is_far_or_near(tmp_path: Path) -> None:
    scanner = Scanner(ScanRule(write_rule(tmp_path / "rule", RULES[0][0], "a", "b")))
    path = write_log(tmp_path / "log.mcap", [message(0, "a", x=1), message(1, "b", z=1)])
    assert scanner.scan(path).problem == "the fields of the rule are never known together"
    assert scanner.scan(path).distance == math.inf
    scanner = Scanner(ScanRule(write_rule(tmp_path / "other", RULES[2][0], "a") / "rule.json"))
    path = write_log(tmp_path / "log.mcap", [message(0, "a", x="text", mode="go")])
    assert scanner.scan(path).nearest[0].distance == FAR
    assert "far away" in scanner.scan(path).nearest[0].words(0)
