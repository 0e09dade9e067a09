"""`riot import` and `riot export` of whole messages: telemetry logs of MAVLink."""

import json

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, DataLossError
from riot_bus.vocabulary.message import Message
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import pack_frame
from riot_bus_mavlink.tlog import tlog_record

APP = make_app()
START = 1_700_000_000 * 10**9
COMMON = load_dialect("common")


def frame(number, message_id=0):
    extra = COMMON.crc_extra(message_id) or 0
    body = bytes([number, 1, 2, 3, 4, 5, 6, 7, 3])
    return pack_frame(message_id, body, extra, version=2, sequence=number, system=1, component=2)


RECORDS = [(START + n * 10**8, frame(n, 0 if n % 2 else 30)) for n in range(20)]
RECORDS.append((START + 3 * 10**9, frame(20, 7_654_321)))
TLOG = b"".join(tlog_record(time, raw) for time, raw in RECORDS)


def riot(*words, error=None):
    done = CliRunner().invoke(APP, [str(word) for word in words], catch_exceptions=True)
    if error is None:
        assert done.exception is None, done.exception
        return done.stdout
    assert isinstance(done.exception, error), done.exception
    return str(done.exception)


@pytest.fixture
def tlog(tmp_path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(TLOG)
    return path


def test_there_and_back_again(tlog, tmp_path):
    log, again = tmp_path / "flight.mcap", tmp_path / "again.tlog"
    assert riot("import", tlog, log) == f"{log}: 21 messages\n"
    with LogReader(log) as reader:
        found = list(reader.messages())
        assert [(each.time, each.payload) for each in found] == RECORDS
        assert {each.key for each in found} == {
            "mavlink_raw/tlog/1/2/HEARTBEAT",
            "mavlink_raw/tlog/1/2/ATTITUDE",
            "mavlink_raw/tlog/1/2/UNKNOWN_7654321",
        }
        assert reader.schemas["mavlink_raw/tlog/1/2/HEARTBEAT"][0].name == "mavlink/HEARTBEAT"
    assert riot("export", log, "-o", again) == f"{again}: 21 messages\n"
    assert again.read_bytes() == TLOG
    out = riot("info", log, "--fields", "--topics", "HEARTBEAT")
    assert "mavlink/HEARTBEAT" in out
    assert "custom_mode" in out
    table = tmp_path / "a.csv"
    riot("export", log, "--field", "mavlink_raw/tlog/1/2/HEARTBEAT:custom_mode", "-o", table)
    assert len(table.read_text().splitlines()) == 11


def test_some_messages(tlog, tmp_path):
    log, out = tmp_path / "flight.mcap", tmp_path / "some.tlog"
    riot("import", tlog, log)
    done = json.loads(riot("export", log, "-o", out, "--topics", "HEARTBEAT", "--end", "1", "--format", "json"))
    assert done == {"file": str(out), "messages": 5, "skipped": 0}
    assert out.read_bytes() == b"".join(tlog_record(*each) for each in RECORDS[1:10:2])


def test_what_is_no_frame_is_skipped(tmp_path):
    log, out = tmp_path / "a.mcap", tmp_path / "a.tlog"
    key = "mavlink_raw/a/1/2/HEARTBEAT"
    with LogWriter(log, registry=TypeRegistry(load_adapters())) as writer:
        writer.write(Message(START, key, frame(1)))
        writer.write(Message(START + 1, key, frame(1)[:-1] + b"\0"))
        writer.write(Message(START + 2, key, b"", kind="delete"))
        writer.write(Message(START + 3, "other", b'{"a": 1}', encoding="application/json"))
        writer.write(Message(START + 4, "other/bytes", b"\xfd\0\0\0"))
        writer.write(Message(START + 5, "elsewhere", frame(2)))
    assert riot("export", log, "-o", out) == f"{out}: 2 messages, 4 others skipped\n"
    assert out.read_bytes() == tlog_record(START, frame(1)) + tlog_record(START + 5, frame(2))
    out.unlink()
    assert "no message of the log" in riot("export", log, "-o", out, "--topics", "other", error=ConfigError)
    assert not out.exists()


def test_damage_is_told_and_the_rest_is_there(tlog, tmp_path):
    broken = bytearray(TLOG)
    broken[30:33] = b"???"
    tlog.write_bytes(bytes(broken))
    log = tmp_path / "flight.mcap"
    assert "have a wrong checksum" in riot("import", tlog, log, error=DataLossError)
    with LogReader(log) as reader:
        assert sum(1 for _ in reader.messages()) == 20


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["import", "{tlog}", "{tlog}"], "file exists"),
        (["import", "{tlog}", "{tlog}", "--force"], "the input itself"),
        (["import", "{tlog}.none", "{log}"], "unknown kind of file '.none'"),
        (["import", "{folder}/none.tlog", "{log}"], "cannot be read"),
        (["import", "{folder}/empty.tlog", "{log}"], "nothing in it"),
        (["export", "{made}", "-o", "{folder}/a.csv"], "no column is wanted"),
        (["export", "{made}", "-o", "{folder}/a.csv", "--field", "a:b", "--topics", "a"], "not for tables"),
        (["export", "{made}", "-o", "{folder}/a.tlog", "--field", "a:b", "--topics", "a"], "for tables"),
        (["export", "{made}", "-o", "{folder}/a.txt"], "unknown kind of file '.txt'"),
        (["export", "{made}", "-o", "{made}"], "unknown kind of file '.mcap'"),
    ],
)
def test_what_cannot_be_done(tlog, tmp_path, words, why):
    (tmp_path / "empty.tlog").write_bytes(b"nothing")
    made, log = tmp_path / "made.mcap", tmp_path / "log.mcap"
    riot("import", tlog, made)
    before = sorted(tmp_path.iterdir())
    names = {"tlog": tlog, "log": log, "folder": tmp_path, "made": made}
    assert why in riot(*(word.format(**names) for word in words), error=ConfigError)
    assert sorted(tmp_path.iterdir()) == before
