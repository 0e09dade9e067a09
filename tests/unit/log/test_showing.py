from __future__ import annotations

import json
import math
from pathlib import Path

from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.findings.records import AbsentRecord, FieldsRecord, MinimalRecord, SimplifiedRecord, StructureRecord
from riot_bus.log.reader import LogReader
from riot_bus.log.showing import ShownLog, show_log
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import bench, command, write_fields, write_minimal


def message(number: int, key: str = "a", kind: str = "put", **fields: object) -> Message:
    payload = json.dumps(fields).encode() if fields else b"\x00" * 7
    return Message(10**18 + number * 10**8, key, payload, sequence=number, kind=kind)


def write(path: Path, delivered: list[Message], originals: list[Message]) -> Path:
    with LogWriter(path) as writer:
        for each in originals:
            writer.write(each, role="original")
        for each in delivered:
            writer.write(each)
    return path


def shown(path: Path, most: int = 20) -> ShownLog:
    with LogReader(path) as reader:
        return show_log(reader, registry=TypeRegistry(), most=most)


def test_what_was_changed_stands_first_and_is_marked(tmp_path: Path) -> None:
    now, before = message(1, x=-3, y=700, note="é"), message(1, x=117, y=700, note="é")
    log = shown(write(tmp_path / "a.mcap", [message(0, x=1, y=2), now], [before]))
    assert list(log.lines()) == [
        "2 messages, 1 changed",
        "#0  +0.000 s  a  json",
        "    x  1",
        "    y  2",
        "#1  +0.100 s  a  json",
        "  * x     117 -> -3",
        "    y     700",
        '    note  "é"',
    ]


def test_of_many_messages_the_changed_ones(tmp_path: Path) -> None:
    many = [message(number, x=number) for number in range(50)]
    originals = [message(number, x=-1) for number in (7, 9, 30)]
    path = write(tmp_path / "a.mcap", many, originals)
    log = shown(path, most=2)
    assert [each.number for each in log.messages] == [7, 9]
    lines = list(log.lines())
    assert lines[0] == "50 messages, 3 changed; these are shown"
    assert lines[-1] == "... 1 further changed message"
    plain = shown(write(tmp_path / "b.mcap", many, []), most=3)
    assert [each.number for each in plain.messages] == [0, 1, 2]
    assert next(plain.lines()) == "50 messages, 0 changed; the first 3 are shown"


def test_what_was_dropped_comes_and_goes_or_moves_in_time_is_told(tmp_path: Path) -> None:
    late = message(1, x=1).with_(time=10**18 + 5 * 10**8)
    added = message(2, x=1, z=9)
    path = write(
        tmp_path / "a.mcap", [message(0, x=1), late, added], [message(1, x=1), message(2, x=1, y=2), message(3, x=5)]
    )
    lines = list(shown(path).lines())
    assert "#2  +0.500 s  a  json  (+0.400 s)" in lines
    assert "  * z  (none) -> 9" in lines
    assert "  * y  2 -> (none)" in lines
    assert "dropped  +0.300 s  a  json" in lines


def test_what_cannot_be_taken_apart_has_its_size(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", [message(0), message(1, kind="delete")], [message(0, x=1)])
    lines = list(shown(path).lines())
    assert lines[1].endswith("(8 -> 7 bytes; 7 bytes of an unknown type)")
    assert lines[2].endswith("(delete)")


def test_output_is_bounded(tmp_path: Path) -> None:
    large = message(0, text="x" * 10_000, array=list(range(1000)), **{f"k{n}": n for n in range(300)})
    lines = list(shown(write(tmp_path / "a.mcap", [large], [])).lines())
    assert len(lines) < 50
    assert max(map(len, lines)) < 120
    assert lines[-1].startswith("    ... ")


def test_only_the_first_elements_are_shown_unless_one_was_changed(tmp_path: Path) -> None:
    before, now = [0.0] * 20, [0.0] * 20
    now[12] = math.nan
    log = shown(write(tmp_path / "a.mcap", [message(0, a=now)], [message(0, a=before)]))
    assert [each.path for each in log.messages[0].fields] == ["a[12]", "len(a)", "a[0]", "a[1]", "a[2]", "a[3]"]
    assert log.messages[0].more == 15


def run(*words: object) -> str:
    done = CliRunner().invoke(make_app("show"), ["show", *map(str, words)])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_the_command_takes_logs_and_findings(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    by_folder = run(one.folder)
    assert by_folder.splitlines()[0] == str(one.folder / "minimal.mcap")
    assert "  * speed  3.0 -> -5.0" in by_folder.splitlines()
    assert run(tmp_path / "out") == by_folder
    assert run(one.folder / "minimal.mcap") == by_folder
    told = json.loads(run(one.folder, "--format", "json"))
    assert told["messages"][0]["fields"][0] == {"path": "speed", "value": -5.0, "before": 3.0}


def test_of_a_finding_it_is_told_what_was_made_simpler_and_what_else_matters(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    simpler = SimplifiedRecord(what="value", name="command:speed", before=-731.5, after=-5.0)
    absent = AbsentRecord(numbers=(0,), topics=("setup",), passed=(3, 3))
    MinimalRecord.load(one.folder).model_copy(update={"simplified": (simpler,), "absent": absent}).save(one.folder)
    write_fields(one)
    key = StructureRecord(
        kind="key", name="command:note", failing_log="a", passing_log="b", failed=(3, 3), passed=(3, 3)
    )
    FieldsRecord.load(one.folder).model_copy(update={"structure": (key,)}).save(one.folder)
    told = [
        "simplified: command:speed: -731.5 -> -5.0",
        "it fails since setup (number 0 of the nominal log) is missing: with it, 3 of 3 trials passed",
        "it needs that command:note is there",
    ]
    assert run(one.folder).splitlines()[-3:] == told
    assert json.loads(run(one.folder, "--format", "json"))["notes"] == told


def test_nothing_moves_the_cursor(tmp_path: Path) -> None:
    odd = command("\x1b[2J\u202e", 1.0)
    path = write(tmp_path / "a.mcap", [odd], [])
    assert "\x1b" not in run(path)
