import subprocess
import sys
import threading

import pytest
from mcap.reader import make_reader

from riot_bus.clock import ManualClock
from riot_bus.errors import ConfigError
from riot_bus.log import writer as module
from riot_bus.log.reader import LogReader, read_log
from riot_bus.log.writer import LogWriter
from riot_bus.message import Message, Qos
from riot_bus.pipeline.event import Change
from riot_bus.types.registry import TypeRegistry

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
    with LogWriter(path, metadata={"seed": "7"}, profile="ros2", compression=compression) as writer:
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
    with LogWriter(path, chunk_bytes=100, chunk_seconds=1.0, clock=clock) as writer:
        writer.write(Message(1, "a", b"x"))
        writer.tick()
        assert read_log(path) == ()
        clock.advance(10**9)
        writer.tick()
        assert len(read_log(path)) == 1
        writer.write(Message(2, "a", b"x" * 100))
        assert len(read_log(path)) == 2
        writer.write(Message(3, "a", b"x"))
        clock.advance(2 * 10**9)
        writer.write(Message(4, "a", b"x"))
        assert len(read_log(path)) == 4


def test_closing_twice_is_fine_and_errors_are_clear(tmp_path):
    writer = LogWriter(tmp_path / "a.mcap")
    writer.close()
    writer.close()
    with pytest.raises(ConfigError, match="did you mean 'zstd'"):
        LogWriter(tmp_path / "a.mcap", compression="zst")
    with pytest.raises(ConfigError, match="cannot write"):
        LogWriter(tmp_path / "no" / "a.mcap")


def test_too_many_keys_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_MAX_CHANNELS", 2)
    with LogWriter(tmp_path / "a.mcap") as writer:
        for n in range(4):
            writer.write(Message(1, f"k{n}", b""))
        assert writer.lost == {"k2": 1, "k3": 1}
    assert len(read_log(tmp_path / "a.mcap")) == 2


def test_times_that_do_not_fit_are_counted_and_spoil_nothing(tmp_path):
    with LogWriter(tmp_path / "a.mcap") as writer:
        for time in (1, -1, 2**64, 2):
            writer.write(Message(time, "a", b"x"))
        assert writer.lost == {"a": 2}
    assert [message.time for message in read_log(tmp_path / "a.mcap")] == [1, 2]


def test_threads_may_share_a_writer(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, chunk_bytes=500) as writer:

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
from riot_bus.log.writer import LogWriter
from riot_bus.message import Message

writer = LogWriter(sys.argv[1], chunk_bytes=2000, metadata={"seed": "7"})
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
