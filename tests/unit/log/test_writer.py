import subprocess
import sys
import threading
import time
from collections import Counter

import pytest
from mcap.reader import make_reader

from riot_bus.log import layout
from riot_bus.log import log_channels as module
from riot_bus.log.engine.mcap_file import McapFile
from riot_bus.log.engine.packing import COMPRESSIONS
from riot_bus.log.reader import LogReader, read_log
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.log.writing_queue import LostMessagesError
from riot_bus.pipeline.event import Change
from riot_bus.types.model import Schema
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.types.serve import Request
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos
from tests.manual_clock import ManualClock

ODD = [
    Message(10, "a", b"1", sequence=1),
    Message(20, "a", b"", kind="delete", sequence=2, attachment=b""),
    Message(20, "a", b"2", encoding="text/plain", attachment=b"\x00" * 33, sequence=2**40),
    Message(30, "a", b"3", qos=Qos(1, "block", True), segment="inside", sequence=3, publish_time=30),
    Message(30, "b/c", b"4", qos=Qos(2), segment="outside", encoding="application/json", publish_time=-5),
    Message(2**64 - 1, "b/c", b"5", publish_time=7),
]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_every_attribute_survives(tmp_path, compression):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(compression=compression), metadata={"seed": "7"}, profile="ros2") as writer:
        for message in ODD:
            writer.write(message)
    with LogReader(path) as reader:
        assert list(reader.messages()) == ODD
        assert reader.metadata == {"seed": "7"}
        assert reader.profile == "ros2"
        assert not reader.loss


def test_originals_and_provenance_are_apart_from_the_delivered_stream(tmp_path):
    path = tmp_path / "a.mcap"
    change = Change("inject", "set", "x", float("nan"), b"\x00")
    drop = Change("inject", "drop", before="a\x00b", after=True)
    with LogWriter(path, registry=TypeRegistry()) as writer:
        writer.write(Message(1, "a", b"{}", sequence=5), role="original")
        writer.write(Message(1, "a", b"[]", sequence=5), changes=[change])
        writer.write(Message(2, "a", b"{}", sequence=6), role="original", changes=[drop])
    with LogReader(path) as reader:
        assert [message.payload for message in reader.messages()] == [b"[]"]
        assert [message.sequence for message in reader.originals()] == [5, 6]
        first, second = reader.provenance()
        assert (first.sequence, first.role, first.key, first.time) == (5, "delivered", "a", 1)
        assert first.changes[0].after == b"\x00"
        assert first.changes[0].before != first.changes[0].before
        assert second.changes == (drop,)
    with path.open("rb") as file:
        found = {
            channel.topic: (channel.message_encoding, record.sequence)
            for _, channel, record in make_reader(file).iter_messages()
        }
    assert found == {"riot/original/a": ("json", 6), "a": ("json", 5)}


def test_chunks_end_by_size_and_by_age(tmp_path):
    path = tmp_path / "a.mcap"
    clock = ManualClock()
    with LogWriter(path, LogSettings(chunk_bytes=2000, chunk_seconds=1.0), clock=clock) as writer:
        writer.write(Message(1, "a", b"x"))
        writer.tick()
        assert read_log(path) == ()
        clock.advance(10**9)
        writer.tick()
        assert len(read_log(path)) == 1
        writer.write(Message(2, "a", b"x" * 2000))
        writer.tick()
        assert len(read_log(path)) == 2
        writer.write(Message(3, "a", b"x"))
        clock.advance(2 * 10**9)
        for number in range(40):
            writer.write(Message(4 + number, "a", b""))
        assert len(read_log(path)) > 4


def eventually(condition):
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline
    return True


def full(*arguments):
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("threaded", [False, True])
def test_what_is_not_in_the_file_when_the_disk_fails_is_named_once_and_what_follows_is_written(
    tmp_path, monkeypatch, threaded
):
    path = tmp_path / "a.mcap"
    writer = LogWriter(path, LogSettings(chunk_bytes=1000, threaded=threaded))
    lost = Counter()

    def write(key, payload=b"", **more):
        while True:
            try:
                writer.write(Message(len(key), key, payload, **more))
            except LostMessagesError as error:
                lost.update(error.lost)
            else:
                return

    write("a", bytes(2000))
    write("bb", attachment=b"x")
    write("ccc", bytes(2000))
    if threaded:
        assert eventually(lambda: len(read_log(path)) == 1)
    with monkeypatch.context() as patch:
        patch.setattr(McapFile, "chunk", full)
        write("dddd", bytes(2000))
        write("eeeee")
        assert eventually(lambda: lost_of(writer, lost).total() == 3)
        assert lost == {(key, "delivered"): 1 for key in ("bb", "ccc", "dddd")}
        assert "No space left on device" in writer.problem
        write("bb", bytes(2000))
    write("bb", b"again")
    writer.close()
    assert writer.problem == ""
    assert [(message.key, message.payload) for message in read_log(path)] == [
        ("a", bytes(2000)),
        ("bb", bytes(2000)),
        ("bb", b"again"),
        ("eeeee", b""),
    ]
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().statistics.message_count == 4
        assert [channel.topic for _, channel, _ in reader.iter_messages()] == ["a", "bb", "bb", "eeeee"]


def lost_of(writer, lost):
    """What is known to be lost, that is: once the other thread has tried."""
    try:
        writer.tick()
    except LostMessagesError as error:
        lost.update(error.lost)
    return lost


def test_a_disk_that_is_full_for_good_leaves_whole_records(tmp_path):
    code = """
import resource, signal, sys, os
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.log.writing_queue import LostMessagesError
from riot_bus.vocabulary.message import Message

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
lost = 0
writer = LogWriter(sys.argv[1], LogSettings(chunk_bytes=30_000))
for n in range(100):
    try:
        writer.write(Message(n, "a", os.urandom(5000), attachment=b"x", sequence=n))
    except LostMessagesError as error:
        lost += 1 + error.lost.total()
try:
    writer.close()
except LostMessagesError as error:
    lost += error.lost.total()
print(lost)
"""
    path = tmp_path / "a.mcap"
    lost = int(subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True).stdout)
    with LogReader(path) as reader:
        messages = list(reader.messages())
        assert (reader.loss.bytes, reader.loss.chunks, reader.loss.details) == (0, 0, 0)
    assert len(messages) + lost == 100
    assert [message.sequence for message in messages] == list(range(len(messages)))
    assert messages
    assert all(message.attachment == b"x" for message in messages)


def test_a_file_that_was_removed_takes_everything_along(tmp_path):
    path = tmp_path / "a.mcap"
    writer = LogWriter(path, LogSettings(chunk_bytes=1000))
    for key in ("a", "b"):
        writer.write(Message(1, key, bytes(2000)))
    path.rename(tmp_path / "b.mcap")  # is still there
    writer.tick()
    (tmp_path / "b.mcap").unlink()
    with pytest.raises(LostMessagesError, match="removed") as caught:
        writer.tick()
    assert caught.value.lost == {("a", "delivered"): 1, ("b", "delivered"): 1}
    with pytest.raises(LostMessagesError, match="removed") as caught:
        writer.write(Message(1, "c", b""))
    assert not caught.value.lost
    writer.close()


def test_every_tool_finds_messages_by_the_indexes(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=500, compression="lz4"), metadata={"seed": "7"}) as writer:
        for n in range(200):
            writer.write(Message(1000 + n, f"k{n % 3}", b"%d" % n, sequence=n, attachment=b"x" if n % 7 == 0 else None))
        writer.note("other", {"a": "b"})
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        statistics = reader.get_summary().statistics
        assert (statistics.message_start_time, statistics.message_end_time) == (1000, 1199)
        assert sum(statistics.channel_message_counts.values()) == statistics.message_count == 200
        assert statistics.chunk_count == len(reader.get_summary().chunk_indexes) > 10
        found = reader.iter_messages(topics=["k1"], starting_at=1050, ending_before=1100)
        assert [message.data for _, _, message in found] == [b"%d" % n for n in range(50, 100) if n % 3 == 1]
        assert {each.name for each in reader.iter_metadata()} == {"riot_bus.run", "other"}
        for index in reader.get_summary().chunk_indexes:
            assert index.message_index_offsets
            for offset in index.message_index_offsets.values():
                file.seek(offset)
                assert file.read(1) == b"\x07"


def test_closing_twice_is_fine_and_errors_are_clear(tmp_path):
    writer = LogWriter(tmp_path / "a.mcap")
    writer.close()
    writer.close()
    with pytest.raises(ConfigError, match="did you mean 'zstd'"):
        LogWriter(tmp_path / "a.mcap", LogSettings(compression="zst"))
    with pytest.raises(ConfigError, match="cannot write"):
        LogWriter(tmp_path / "no" / "a.mcap")


def test_too_many_keys_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_MAX_CHANNELS", 2)
    with LogWriter(tmp_path / "a.mcap") as writer:
        for n in range(4):
            writer.write(Message(1, f"k{n}", b""))
        assert writer.refused == 2
    assert len(read_log(tmp_path / "a.mcap")) == 2


def test_times_that_do_not_fit_are_counted_and_spoil_nothing(tmp_path):
    with LogWriter(tmp_path / "a.mcap") as writer:
        for time in (1, -1, 2**64, 2):
            writer.write(Message(time, "a", b"x"))
        assert writer.refused == 2
    assert [message.time for message in read_log(tmp_path / "a.mcap")] == [1, 2]


def test_threads_may_share_a_writer(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=500)) as writer:

        def work(name):
            for n in range(300):
                writer.write(Message(n, name, b"%d" % n, attachment=name.encode(), sequence=n))

        threads = [threading.Thread(target=work, args=(f"t{n}",)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    messages = read_log(path)
    assert len(messages) == 1200
    assert all(m.attachment == m.key.encode() and m.payload == b"%d" % m.sequence for m in messages)


WRITER = """
import sys
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message

writer = LogWriter(sys.argv[1], LogSettings(chunk_bytes=2000), metadata={"seed": "7"})
n = 0
while True:
    writer.write(Message(n, "a", b"%d" % n, attachment=b"at %d" % n, sequence=n))
    n += 1
    if n % 1000 == 0:
        print(n, flush=True)
"""


def test_kill_9_loses_the_last_chunk_only(tmp_path):
    path = tmp_path / "a.mcap"
    process = subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True)
    try:
        for line in process.stdout:
            if (written := int(line)) >= 3000:
                break
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    with LogReader(path) as reader:
        messages = list(reader.messages())
        assert reader.loss.unfinished
        assert reader.metadata == {"seed": "7"}
    assert len(messages) >= written - 100
    assert messages == [Message(n, "a", b"%d" % n, attachment=b"at %d" % n, sequence=n) for n in range(len(messages))]


def rows_of(writer, messages):
    found = []
    for each in messages:
        number, constants = writer.track(each)
        extras = layout.extras_of(each, constants)
        published = each.time if each.publish_time is None else each.publish_time
        found.append((number, each.sequence, each.time, published, each.payload, extras))
    return found


@pytest.mark.parametrize("threaded", [False, True])
def test_messages_that_were_taken_apart_already_are_written_as_others_are(tmp_path, threaded):
    log = [
        Message(1 + n, f"k{n % 3}", bytes(n % 50), sequence=n, publish_time=n, attachment=b"x" if n % 5 == 0 else None)
        for n in range(1000)
    ]
    with LogWriter(tmp_path / "a.mcap", LogSettings(chunk_bytes=2000, threaded=threaded)) as writer:
        rows = rows_of(writer, log)
        for start in range(0, len(rows), 70):
            writer.append(rows[start : start + 70])
    with LogWriter(tmp_path / "b.mcap", LogSettings(chunk_bytes=2000)) as writer:
        for each in log:
            writer.write(each)
    assert list(read_log(tmp_path / "a.mcap")) == list(read_log(tmp_path / "b.mcap")) == log
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 1000
        assert len(reader.get_summary().chunk_indexes) > 10


class Stuck:
    """A disk that takes nothing until it is told to."""

    def __init__(self, monkeypatch):
        self.free = threading.Event()
        whole = McapFile.chunk

        def chunk(file, *arguments):
            assert self.free.wait(30)
            whole(file, *arguments)

        monkeypatch.setattr(McapFile, "chunk", chunk)


def offer(writer, key, count, lost, *, patient):
    """Append messages of a chunk each."""
    (row,) = rows_of(writer, [Message(1, key, bytes(1000))])
    for _ in range(count):
        try:
            writer.append([row], patient=patient)
        except LostMessagesError as error:
            lost.update(error.reasons["too slow"])


def test_a_disk_that_is_too_slow_costs_what_is_counted_and_stalls_nobody(tmp_path, monkeypatch):
    disk, lost = Stuck(monkeypatch), Counter()
    path = tmp_path / "a.mcap"
    writer = LogWriter(path, LogSettings(chunk_bytes=1000, threaded=True, queue_bytes=5000, patience=3600.0))
    offer(writer, "a", 20, lost, patient=False)
    assert writer.queued_bytes <= 5000
    assert "too slow" in writer.problem
    offer(writer, "b", 1, lost, patient=True)  # which would take an hour, but waiting was in vain before
    assert 10 < lost["a", "delivered"] < 20
    assert lost["b", "delivered"] == 1
    disk.free.set()
    assert eventually(lambda: not (writer.tick() or writer.queued_bytes))
    offer(writer, "b", 3, lost, patient=False)
    writer.close()
    assert writer.problem == ""
    written = Counter(message.key for message in read_log(path))
    assert written["a"] + lost["a", "delivered"] == 20
    assert written["b"] + lost["b", "delivered"] == 4
    with path.open("rb") as file:
        assert {channel.topic for _, channel, _ in make_reader(file).iter_messages()} == {"a", "b"}


def test_who_is_patient_waits_for_room(tmp_path, monkeypatch):
    disk, lost = Stuck(monkeypatch), Counter()
    writer = LogWriter(
        tmp_path / "a.mcap", LogSettings(chunk_bytes=1000, threaded=True, queue_bytes=3000, patience=30.0)
    )
    thread = threading.Thread(target=offer, args=(writer, "a", 20, lost), kwargs={"patient": True})
    thread.start()
    assert eventually(lambda: writer.queued_bytes > 2000)
    disk.free.set()
    thread.join()
    writer.close()
    assert not lost
    assert len(read_log(tmp_path / "a.mcap")) == 20


def test_flush_makes_everything_readable_and_counted(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(threaded=True)) as writer:
        for n in range(5):
            writer.write(Message(10 + n, f"k{n % 2}", b"x"))
        assert read_log(path) == ()
        writer.flush()
        assert len(read_log(path)) == 5
        assert writer.counts() == {1: 3, 2: 2}
        assert writer.span() == (10, 14)
        assert [each.topic for each in writer.definitions()[1]] == ["k0", "k1"]
        assert writer.size >= path.stat().st_size > 0
    with LogWriter(tmp_path / "b.mcap") as writer:
        writer.flush()
        assert (writer.counts(), writer.span()) == ({}, (0, 0))


@pytest.mark.parametrize("threaded", [False, True])
def test_a_disk_that_cannot_promise_is_said(tmp_path, monkeypatch, threaded):
    def failing(file):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(McapFile, "sync", failing)
    writer = LogWriter(tmp_path / "a.mcap", LogSettings(durable=True, threaded=threaded))
    writer.write(Message(1, "a", b"x"))
    with pytest.raises(LostMessagesError, match="Input/output error") as caught:
        writer.close()
    assert (caught.value.lost, caught.value.errno) == (Counter(), 5)
    assert len(read_log(tmp_path / "a.mcap")) == 1


def test_chunks_do_not_wait_for_a_disk_that_takes_long_to_promise(tmp_path, monkeypatch):
    free = threading.Event()
    monkeypatch.setattr(McapFile, "sync", lambda file: free.wait(30))
    path = tmp_path / "a.mcap"
    writer = LogWriter(path, LogSettings(chunk_bytes=100, durable=True, threaded=True, queue_bytes=10_000))
    for n in range(50):
        writer.write(Message(n, "a", bytes(200)))
    assert eventually(lambda: len(read_log(path)) >= 49)
    free.set()
    writer.close()
    assert len(read_log(path)) == 50


@pytest.mark.parametrize("threaded", [False, True])
def test_whatever_goes_wrong_with_a_chunk_what_is_lost_is_named(tmp_path, monkeypatch, threaded):
    def failing(data):
        raise MemoryError

    path, lost = tmp_path / "a.mcap", Counter()
    writer = LogWriter(path, LogSettings(threaded=threaded))
    for key, broken in (("a", False), ("b", True), ("c", False)):
        with monkeypatch.context() as patch:
            if broken:
                patch.setitem(COMPRESSIONS, "zstd", failing)
            writer.write(Message(1, key, b"x", attachment=b"y"))
            try:
                writer.flush()
            except LostMessagesError as error:
                lost.update(error.lost)
    writer.close()
    assert lost == {("b", "delivered"): 1}
    assert [message.key for message in read_log(path)] == ["a", "c"]
    with LogReader(path) as reader:
        assert len(list(reader.messages())) == 2
        assert not reader.loss


def test_calls_have_channels_of_their_own_with_names_that_are_valid_elsewhere(tmp_path):
    path = tmp_path / "a.mcap"
    written = [
        Request(1, "calc/add/@request", b"a", sequence=1, parameters="x=1"),
        Request(2, "calc/add/@request", b"b", sequence=2),
        Message(3, "calc/add/@reply", b"", kind="delete", sequence=1, attachment=b"x"),
        Message(4, "calc/add/@error", b"no", sequence=2),
    ]
    with LogWriter(path) as writer:
        for message in written:
            writer.write(message)
        writer.write(written[0], role="original")
    with path.open("rb") as file:
        names = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    calls = {"riot/request/calc/add", "riot/reply/calc/add", "riot/error/calc/add"}
    assert names == {*calls, "riot/original/riot/request/calc/add"}
    with LogReader(path) as reader:
        read = list(reader.messages())
        assert read == [written[0], Message(2, "calc/add/@request", b"b", sequence=2), *written[2:]]
        assert read[0].parameters == "x=1"
        assert [each.key for each in reader.messages(topics=["calc/add/@reply"])] == ["calc/add/@reply"]
        assert list(reader.messages(topics=["**"])) == []
        assert list(reader.originals()) == written[:1]


def test_a_type_that_becomes_known_has_a_channel_of_its_own(tmp_path):
    path = tmp_path / "a.mcap"
    registry = TypeRegistry(load_adapters(["ros2"]))
    key = "0/x/my_pkg::msg::dds_::Odd_/RIHS01_" + "0" * 64
    with LogWriter(path, registry=registry) as writer:
        writer.write(Message(1, key, b"1", sequence=1))
        writer.write(Message(1, key, b"1", sequence=1), role="original")
        registry.add_schema(key, Schema("my_pkg/msg/Odd", "ros2msg", b"int8 x\n"), "cdr")
        writer.write(Message(2, key, b"2", sequence=2))  # whoever holds a track goes on with it
        writer.renew(key)
        writer.renew("no/such/key")
        writer.write(Message(3, key, b"3", sequence=3))
        writer.write(Message(3, key, b"3", sequence=3), role="original")
        writer.write(Message(4, key, b"4", sequence=4))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    found = [
        (channel.topic, summary.statistics.channel_message_counts[number], summary.schemas[channel.schema_id].data)
        for number, channel in summary.channels.items()
    ]
    delivered, original = found[0][0], found[1][0]
    assert found == [(delivered, 2, b""), (original, 1, b""), (delivered, 2, b"int8 x\n"), (original, 1, b"int8 x\n")]
    with LogReader(path) as reader:
        assert [message.payload for message in reader.messages()] == [b"1", b"2", b"3", b"4"]
        assert [message.payload for message in reader.originals()] == [b"1", b"3"]
