from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from riot_bus.findings.records import CertificateRecord, FieldRecord, FieldsRecord, FindingRecord
from riot_bus.inject.apply import inject_log
from riot_bus.log.writer import LogWriter
from riot_bus.pipeline.event import Change
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.testcases import load_case_template

INJECTIONS = (
    Injection("a", "v", math.inf, first=2, last=4, seed=7),
    Injection("a", "w", Signal(1.0, 2.0, 5, 3)),
    Injection("a", "w", Signal(1.0, 2.0, 5, 3, integer=True, choices=("on", 2, False))),
    Injection("a", "w", Curve((0.0, 1.5), (3.0, -4.0), integer=True)),
    Injection("a", "len(xs)", Formula("2 * n", base="part")),
    Injection("b", "data", b"\x00\xff"),
    Injection("b", fault="drop"),
    Injection("b", fault="mine", options=(("blob", b"\x00"), ("factor", 2.0))),
)


def finding(folder: Path, *injections: Injection) -> Path:
    record = FindingRecord(
        id="crash-unit-1", system="s", system_file="/s/riot.toml", unit="unit", component="unit", monitor="crash",
        signature="crash:unit:main.py:3", injections=tuple(each.row() for each in injections),
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    record.save(folder)
    return folder


def test_a_plan(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('[[inject]]\ntopic = "a"\nfield = "v"\nvalue = 1\nfirst = 3\nlast = 5\n')
    found = load_case_template(path)
    assert found.injections == (Injection("a", "v", 1, first=3, last=5),)
    assert (found.signature, found.unit, found.system) == (None, None, None)
    assert found.anywhere().injections == (Injection("a", "v", 1),)
    assert found.digest() != found.anywhere().digest()


def test_a_finding(tmp_path: Path) -> None:
    folder = finding(tmp_path / "findings" / "crash-unit-1", *INJECTIONS)
    found = load_case_template(folder)
    assert found.injections == INJECTIONS
    assert (found.signature, found.unit, found.system) == ("crash:unit:main.py:3", "unit", "/s/riot.toml")
    assert load_case_template(tmp_path) == found  # the only one of an output folder


def test_certificates(tmp_path: Path) -> None:
    folder = finding(tmp_path / "f", INJECTIONS[0])
    logs = {"failing_log": "", "passing_log": ""}
    sides: dict[str, Any] = {"passing": 1.0, **logs, "confirmed_failing": 3, "confirmed_passing": 3, "repeats": 3}
    certificate = CertificateRecord(failing=5.0, **sides)
    fields = tuple(
        FieldRecord(name=name, kind=kind, type="float", failing=5.0, certificate=certificate)  # type: ignore[arg-type]
        for name, kind in (("a[0]:v.x[2]", "exceptional"), ("a[1]:v.x[2]", "exceptional"), ("a[0]:mode", "nominal"))
    )
    FieldsRecord(fields=fields, considered=(), bound=0.1, straight=1).save(folder)
    found = load_case_template(folder / "fields.json")
    assert found.injections == (Injection("a", "v.x[2]", 5.0),)
    assert found.signature == "crash:unit:main.py:3"


def test_a_log_that_tells_what_was_changed(tmp_path: Path) -> None:
    registry = TypeRegistry()
    log = [Message(10**18 + number, "ab"[number % 2], b'{"v": %d}' % number, sequence=number) for number in range(8)]
    injections = (Injection("a", "v", -1, first=1, last=2), Injection("b", "v", -2, first=3))
    delivered, touched = inject_log(log, injections, registry=registry)
    changes = {original.sequence: (original, made) for _, original, made in touched}
    with LogWriter(tmp_path / "failure.mcap", metadata={"signature": "crash:x"}) as writer:
        for message in delivered:
            if message.sequence in changes:
                original, made = changes[message.sequence]
                writer.write(original, role="original", changes=made)
            writer.write(message)
    found = load_case_template(tmp_path / "failure.mcap")
    assert found.signature == "crash:x"
    again, _ = inject_log(log, found.injections, registry=registry)
    assert [each.payload for each in again] == [each.payload for each in delivered]
    folder = finding(tmp_path, INJECTIONS[0])
    near = load_case_template(folder / "failure.mcap")
    assert (near.unit, near.injections) == ("unit", found.injections)


def test_topics_of_a_log_have_the_names_that_it_records(tmp_path: Path) -> None:
    key = f"0/odom/my_pkg::msg::dds_::Odd_/RIHS01_{'0' * 64}"
    original, changed = (Message(10**18, key, b'{"v": %d}' % value, sequence=1) for value in (5, -1))
    with LogWriter(tmp_path / "run.mcap", registry=TypeRegistry(load_adapters(["ros2"]))) as writer:
        writer.write(original, role="original", changes=(Change("injector", "set", "v", 5, -1),))
        writer.write(changed)
    assert load_case_template(tmp_path / "run.mcap").injections == (Injection("/odom", "v", -1, first=0, last=0),)


def test_what_is_no_test_case(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        load_case_template(tmp_path / "none")
    (tmp_path / "x.txt").touch()
    with pytest.raises(ConfigError, match="not a test case"):
        load_case_template(tmp_path / "x.txt")
    (tmp_path / "empty.toml").write_text("")
    with pytest.raises(ConfigError, match="it injects nothing"):
        load_case_template(tmp_path / "empty.toml")
    with LogWriter(tmp_path / "plain.mcap") as writer:
        writer.write(Message(1, "a", b"{}"))
    with pytest.raises(ConfigError, match="it injects nothing"):
        load_case_template(tmp_path / "plain.mcap")
    with pytest.raises(ConfigError, match="no finding"):
        load_case_template(tmp_path)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"topc": "a"}, "unknown key 'topc'"),
        ({"field": "v"}, "this injection cannot be used"),
        ({"topic": "a", "value": {"x": 1}}, "this injection cannot be used"),
        ({"topic": "a", "fault": "mine", "options": [["x", [1]]]}, "this injection cannot be used"),
        ({"topic": "a", "value": "b'\\x"}, "this injection cannot be used"),
    ],
)
def test_damaged_findings(tmp_path: Path, row: dict[str, Any], message: str) -> None:
    folder = finding(tmp_path / "f", INJECTIONS[0])
    path = folder / "finding.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "injections": [row]}))
    with pytest.raises(ConfigError, match=message):
        load_case_template(folder)


def test_what_was_found_in_the_whole_system_is_no_test_case_of_a_unit(tmp_path: Path) -> None:
    folder = finding(tmp_path / "one", *INJECTIONS)
    FindingRecord.load(folder).model_copy(update={"whole_system": True}).save(folder)
    with pytest.raises(ConfigError, match="not a test case of a unit"):
        load_case_template(folder)
