from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.chain.base.external import ExternalField, driving_log, external_fields, left_out, message_rate
from riot_bus.log.writer import LogWriter
from riot_bus.system.system_file import RunPace
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import LOGGED as LOGGED_ALONE
from tests.unit.chain.machine import SYSTEM, bench, write_nominal

LOGGED = SYSTEM.replace('name = "machine"', 'name = "machine"\nnominal = "nominal.mcap"')


def log(folder: Path, rows: list[dict], topic: str = "panel") -> None:
    with LogWriter(folder / "nominal.mcap") as writer:
        for number, row in enumerate(rows):
            writer.write(Message(10**18 + number * 500_000_000, topic, json.dumps(row).encode()))


def test_fields_come_with_what_they_did_in_the_nominal_log(tmp_path: Path) -> None:
    system = LOGGED.replace("[external.ranges]", 'exclude = ["panel:lever"]\n\n[external.ranges]')
    rows = [{"knob": knob, "still": 20, "zero": 0, "lever": 1.0, "name": "x", "on": True} for knob in (1.0, 3.0, 5.0)]
    log(tmp_path, [*rows, {"knob": float("nan"), "still": 20, "zero": 0}])
    fields = {field.path: field for field in external_fields(bench(tmp_path, system).workspace)}
    assert set(fields) == {"knob", "still", "zero", "on", "name"}
    name = fields.pop("name")
    assert (name.choices, name.alone) == (("x",), True)
    assert (fields["on"].low, fields["on"].high, fields["on"].range, fields["on"].integer) == (0, 1, (0, 1), True)
    knob, still, zero = fields["knob"], fields["still"], fields["zero"]
    assert (knob.nominal, knob.low, knob.high, knob.range, knob.rate) == (3.0, 1.0, 5.0, (-1000, 1000), 2.0)
    assert (still.spread, still.range, still.integer) == (2.0, (20 - 5000, 20 + 5000), True)
    assert (still.low, still.high) == (18, 22)
    assert (zero.spread, knob.integer) == (1.0, False)


def test_values_stay_within_their_type(tmp_path: Path) -> None:
    types = '[system]\nname = "machine"\nnominal = "nominal.mcap"\ntypes = { "/level" = "std_msgs/msg/UInt8" }'
    system = SYSTEM.replace('[system]\nname = "machine"', types).replace('topics = ["panel"]', 'topics = ["/level"]')
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for number in range(3):
            writer.write(Message(10**18 + number, "/level", bytes([0, 1, 0, 0, 254]), encoding="cdr"))
    (level,) = external_fields(bench(tmp_path, system).workspace)
    assert (level.type, level.nominal, level.range) == ("uint8", 254, (0, 255))
    assert (level.low, level.high) == (254 - 25.4, 255)


@pytest.mark.parametrize(
    ("kind", "least", "most"),
    [("int64", -(2**63), 2**63 - 1), ("uint64", 0, 2**64 - 1), ("int8", -128, 127), ("bool", 0, 1)],
)
def test_what_is_told_of_a_whole_number_is_a_value_of_its_type(kind: str, least: int, most: int) -> None:
    low, high = float(least), float(most)  # of 64 bits, the largest is rounded up
    field = ExternalField("a:x", "a", "x", kind, 0.0, 1.0, low, high, (low, high), 1.0)
    assert (field.told(low), field.told(high)) == (least, most)


def test_lengths_of_arrays_are_fields(tmp_path: Path) -> None:
    log(tmp_path, [{"load": [1.0] * size, "path": [{"x": 1.0}] * 40, "name": "x"} for size in (3, 4, 5)])
    fields = {field.path: field for field in external_fields(bench(tmp_path, LOGGED).workspace)}
    load, path = fields["len(load)"], fields["len(path)"]
    assert (load.type, load.integer, load.nominal, load.low, load.high, load.range) == (
        "uint32",
        True,
        4,
        3,
        5,
        (0, 20),
    )
    assert (path.nominal, path.low, path.high, path.range) == (40, 36, 44, (0, 160))
    assert load.injection(7.0) == Injection("panel", "len(load)", 7)
    apart = LOGGED.replace("[external.ranges]", 'exclude = ["panel:path"]\n\n[external.ranges]\n"*:len(load)" = [1, 9]')
    fields = {field.path: field for field in external_fields(bench(tmp_path, apart).workspace)}
    assert "len(path)" not in fields
    assert fields["len(load)"].range == (1, 9)


TIMED = LOGGED.replace(
    "[external.ranges]", 'timing = ["panel"]\n\n[external.ranges]\n"*:#loss" = [0, 1]\n"*" = [-9, 9]'
)


def test_messages_may_be_late_or_get_lost_where_riot_toml_says_so(tmp_path: Path) -> None:
    log(tmp_path, [{"knob": 1.0}] * 5)
    fields = {field.path: field for field in external_fields(bench(tmp_path, TIMED).workspace)}
    delay, loss = fields["#delay"], fields["#loss"]
    assert (delay.name, delay.nominal, delay.range) == ("panel:#delay", 0.0, (0.0, 5.0))
    assert (loss.constant, loss.integer, loss.range) == (True, False, (0.0, 1.0))
    assert fields["knob"].constant is False
    assert delay.injection(1.5, speed=3.0) == Injection("panel", fault="delay", delay=0.5)
    assert loss.injection(0.25, speed=3.0) == Injection("panel", fault="drop", probability=0.25)


@pytest.mark.parametrize(
    ("stated", "words"),
    [('"*:#loss" = [0, 1.5]', "a share of 1.5 cannot be lost"), ('"*:#delay" = [0, 0]', "is not a range from 0 up")],
)
def test_what_cannot_be_late_or_lost_is_told(tmp_path: Path, stated: str, words: str) -> None:
    log(tmp_path, [{"knob": 1.0}] * 5)
    with pytest.raises(ConfigError, match=words):
        external_fields(bench(tmp_path, TIMED.replace('"*:#loss" = [0, 1]', stated)).workspace)
    apart = TIMED.replace('timing = ["panel"]', 'timing = ["panel"]\nexclude = ["panel:#*"]')
    assert [field.path for field in external_fields(bench(tmp_path, apart).workspace)] == ["knob"]


def test_of_a_topic_that_did_not_come_nothing_can_be_late(tmp_path: Path) -> None:
    log(tmp_path, [{"knob": 1.0}])
    with pytest.raises(ConfigError, match=r"no message of 'panels'[^?]*'panel'\?"):
        external_fields(bench(tmp_path, TIMED.replace('timing = ["panel"]', 'timing = ["panels"]')).workspace)


def test_a_field_that_is_never_finite_is_left_out(tmp_path: Path) -> None:
    log(tmp_path, [{"knob": float("inf"), "lever": 0.5}] * 3)
    assert [field.path for field in external_fields(bench(tmp_path, LOGGED).workspace)] == ["lever"]


def test_what_is_no_field_is_told_with_the_reason(tmp_path: Path) -> None:
    system = LOGGED.replace('topics = ["panel"]', 'topics = ["panel", "button", "raw"]')
    system = system.replace("[external.ranges]", 'exclude = ["panel:heat"]\n\n[external.ranges]')
    row = {"knob": 1.0, "lever": float("inf"), "heat": 2.0, "seq": 3, "belt": [{"x": 1.0}] * 6, "name": "x"}
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for number in range(3):
            writer.write(Message(10**18 + number, "panel", json.dumps(row).encode()))
            writer.write(Message(10**18 + number, "raw", b"\x00\xff\x01", encoding="application/octet-stream"))
    workspace = bench(tmp_path, system).workspace
    fields = external_fields(workspace)
    assert left_out(workspace, fields) == {
        "button": "a topic without a message in the nominal log",
        "raw": "messages of a type that is not known",
        "panel:lever": "never a finite number in the nominal log",
        "panel:seq": "a sequence number, which is left alone",
        "panel:belt[*].x": "of an array, only the first 4 elements are driven",
    }


def test_a_log_without_external_topics_suggests_what_it_has(tmp_path: Path) -> None:
    log(tmp_path, [{"knob": 1.0}], "panels")
    with pytest.raises(ConfigError, match=r"no field of panel[^?]*'panels'\?"):
        external_fields(bench(tmp_path, LOGGED).workspace)


def test_riot_toml_has_to_name_what_is_external(tmp_path: Path) -> None:
    system = SYSTEM[: SYSTEM.index("[external]")] + "[unit.drive]\n"
    with pytest.raises(ConfigError, match="no external topics"):
        external_fields(bench(tmp_path, system).workspace)


def test_a_log_drives_the_system_where_no_component_does_at_the_pace_of_the_run(tmp_path: Path) -> None:
    system = LOGGED_ALONE.replace(
        'name = "machine"\n', 'name = "machine"\nnominal_run = { duration = 60, speed = 2 }\n'
    )
    write_nominal(tmp_path)
    workspace = bench(tmp_path, system).workspace
    driving = driving_log(workspace, RunPace(duration=3.0, speed=4.0))
    assert {message.key for message in driving} == {"panel"}
    assert len(driving) == 31  # 1.5 s of the log, which has twice the speed, at 20 messages a second
    assert (driving[-1].time - driving[0].time) / 1e9 == pytest.approx(0.75)
    assert driving_log(bench(tmp_path, LOGGED).workspace, RunPace(duration=3.0)) == ()


def test_components_that_drive_the_system_need_a_segment_of_their_own(tmp_path: Path) -> None:
    shared = bench(tmp_path, LOGGED.replace('segment = "shop"', 'segment = "inside"')).workspace
    with pytest.raises(ConfigError, match="share segment 'inside' with the system"):
        driving_log(shared, RunPace(duration=3.0))


def test_one_message_has_no_rate() -> None:
    assert message_rate([5]) == 0.0
    assert message_rate([0, 10**9, 2 * 10**9]) == 1.0
