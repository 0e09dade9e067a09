import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.pipeline.event import Change
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos
from tests.manual_clock import ManualClock
from tests.tiers import scaled

keys = st.sampled_from(["a", "rover/odom", "ü/€", "0/x/std_msgs::msg::dds_::String_/TypeHashNotSupported"]) | st.text(
    st.characters(exclude_categories=["Cs"]), min_size=1, max_size=8
)
stamps = st.integers(0, 2**64 - 1) | st.integers(0, 20)
messages = st.builds(
    Message,
    time=stamps,
    key=keys,
    payload=st.binary(max_size=60),
    kind=st.sampled_from(["put", "delete"]),
    encoding=st.sampled_from(["", "application/json", "text/plain;x"]),
    attachment=st.none() | st.binary(max_size=40),
    qos=st.builds(Qos, st.integers(1, 7), st.sampled_from(["drop", "block", "block_first"]), st.booleans()),
    segment=st.sampled_from(["", "inside", "outside"]),
    sequence=st.integers(0, 2**32 - 1) | st.integers(0, 2**63 - 1),
    publish_time=st.none() | stamps | st.integers(-(2**63), 2**64 - 1),
)
scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text() | st.binary()
changes = st.lists(
    st.builds(Change, st.text(max_size=5), st.text(max_size=5), st.none() | st.text(max_size=5), scalars, scalars),
    max_size=2,
)
roles = st.sampled_from(["delivered", "original"])
settings.register_profile("log", deadline=None, max_examples=scaled(60))


def write(path, rows, compression="zstd", chunk_bytes=200, close=True):
    writer = LogWriter(
        path, LogSettings(compression=compression, chunk_bytes=chunk_bytes), clock=ManualClock(), metadata={"seed": "1"}
    )
    for message, role, what in rows:
        writer.write(message, role=role, changes=what)
    if close:
        writer.close()
    return writer


@settings(settings.get_profile("log"))
@given(
    st.lists(st.tuples(messages, roles, changes), max_size=20),
    st.sampled_from(["zstd", "lz4", "none"]),
    st.integers(1, 2000),
)
def test_round_trip(rows, compression, chunk_bytes):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.mcap")
        write(path, rows, compression, chunk_bytes)
        with LogReader(path) as reader:
            for role in ("delivered", "original"):
                expected = sorted((m for m, r, _ in rows if r == role), key=lambda message: message.time)
                assert list(reader.messages(role=role)) == expected
            noted = [(m.sequence, m.key, m.time, r, tuple(what)) for m, r, what in rows if what]
            assert [(p.sequence, p.key, p.time, p.role, p.changes) for p in reader.provenance()] == noted
            assert not reader.loss


@settings(settings.get_profile("log"))
@given(st.lists(messages, min_size=1, max_size=12), st.sampled_from(["zstd", "none"]), st.data())
def test_cut_anywhere_yields_a_prefix(log, compression, data):
    log = [message.with_(time=n) for n, message in enumerate(log)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.mcap")
        write(path, [(message, "delivered", [Change("i", "set")]) for message in log], compression)
        whole = path.read_bytes()
        for size in data.draw(st.lists(st.integers(0, len(whole) - 1), min_size=5, max_size=15)):
            check_cut(path, whole, size, log)


def check_cut(path, whole, size, log):
    path.write_bytes(whole[:size])
    try:
        reader = LogReader(path)
    except ConfigError:
        assert size < 8
        return 0
    with reader:
        found = list(reader.messages())
        assert found == log[: len(found)]
        assert len(list(reader.provenance())) <= len(log)
        assert reader.metadata in ({}, {"seed": "1"})
        assert len(found) == len(log) or reader.loss
        return len(found)


def test_cut_at_every_byte(tmp_path):
    path = tmp_path / "a.mcap"
    log = [Message(n, "ab"[n % 2], b"payload %d" % n, attachment=b"%d" % n, sequence=n) for n in range(9)]
    write(path, [(message, "delivered", []) for message in log], chunk_bytes=150)
    whole = path.read_bytes()
    counts = [check_cut(path, whole, size, log) for size in range(len(whole))]
    assert counts == sorted(counts)
    assert counts[-1] == 9


@settings(settings.get_profile("log"))
@given(st.lists(messages, min_size=1, max_size=8), st.data())
def test_flipped_bits_never_raise(log, data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.mcap")
        write(path, [(message, "delivered", [Change("i", "set", "x", 1, 2)]) for message in log], "none")
        whole = bytearray(path.read_bytes())
        for _ in range(5):
            at = data.draw(st.integers(8, len(whole) - 1))
            whole[at] = data.draw(st.integers(0, 255))
        path.write_bytes(whole)
        with LogReader(path) as reader:
            assert len(list(reader.messages())) + len(list(reader.originals())) <= len(log) * 2
            list(reader.provenance())
            str((reader.loss, reader.schemas, reader.metadata, reader.profile))
