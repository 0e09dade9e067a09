"""Any log and any combination of edits: what is not touched is byte for byte what it was, and nothing else is there."""

from __future__ import annotations

import json
import struct
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from riot_bus.log.playback.sources import LogSource, MergedSource, PipedSource
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.pipeline.event import Change
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos
from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions
from tests.manual_clock import ManualClock
from tests.tiers import scaled
from tests.unit.riot_bus_logtools.editing.edit_tools import Raw, metadata, raw

TOPICS = ("/a", "/b/c", "/b/d")
times = st.integers(10**9, 10**9 + 300) | st.integers(10**9, 1 << 63)
rows = st.lists(
    st.tuples(st.sampled_from(TOPICS), times, st.integers(0, 9) | st.none(), st.integers(0, 2**32 - 1)), max_size=25
)
kinds = st.fixed_dictionaries(
    {
        "compression": st.sampled_from(list(CompressionType)),
        "chunk_size": st.integers(1, 600),
        "use_chunking": st.booleans(),
        "use_statistics": st.booleans(),
    }
)
edits = st.fixed_dictionaries(
    {
        "changes": st.sampled_from([(), ("/a:v = 77",), ("/b/*:v += 1 where v > 3", "/a:v *= 2 index 1..4")]),
        "keep": st.sampled_from([(), ("/a", "/b/c every 2"), ("** where v != 5",), ("/b/**",)]),
        "drop": st.sampled_from([(), ("/b/d",), ("/a index 2..3", "/b/c where v < 2")]),
        "shift": st.sampled_from([0, 7, -5]),
        "shift_a": st.sampled_from([0, 0, 1000]),
        "remap": st.sampled_from([(), ("/b/**:=/x/**",), ("/a:=/new/a",)]),
        "compression": st.sampled_from([None, "zstd", "lz4", "none"]),
        "chunk_bytes": st.sampled_from([1, 300, 1 << 20]),
        "sort": st.booleans(),
    }
)
common = settings(deadline=None, max_examples=scaled(50))


def payload(value: int | None) -> bytes:
    return b"\x80 not JSON" if value is None else b'{ "v" : %d }' % value


def write(path: Path, log: list[Any], **kind: Any) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **kind)
        writer.start(profile="x")
        for topic in TOPICS:
            schema = writer.register_schema(f"type{topic}", "jsonschema", topic.encode())
            writer.register_channel(topic, "json", schema, {"of": topic, "n": "1"})
        for topic, time, value, sequence in log:
            writer.add_message(TOPICS.index(topic) + 1, time, payload(value), time // 2, sequence)
        writer.finish()  # type: ignore[no-untyped-call]


def expected(before: list[Raw], options: dict[str, Any], *, by_time: bool) -> list[Raw]:
    """What the options mean, said once more and simply."""
    if by_time:
        before = sorted(before, key=lambda each: each.time)
    numbers = dict.fromkeys(TOPICS, -1)
    found = []
    for each in before:
        topic = each.topic
        numbers[topic] += 1
        number = numbers[topic]
        value = None if each.data.startswith(b"\x80") else json.loads(each.data)["v"]
        keeps = {
            (): True,
            ("/a", "/b/c every 2"): topic == "/a" or (topic == "/b/c" and number % 2 == 0),
            ("** where v != 5",): value is not None and value != 5,
            ("/b/**",): topic.startswith("/b/"),
        }[options["keep"]]
        drops = {
            (): False,
            ("/b/d",): topic == "/b/d",
            ("/a index 2..3", "/b/c where v < 2"): (topic == "/a" and number == 2)
            or (topic == "/b/c" and value is not None and value < 2),
        }[options["drop"]]
        if not keeps or drops:
            continue
        if value is not None and options["changes"] == ("/a:v = 77",) and topic == "/a":
            value = 77
        if value is not None and len(options["changes"]) == 2:
            value += topic != "/a" and value > 3
            value *= 2 if topic == "/a" and 1 <= number < 4 else 1
        delta = options["shift"] * 10**9 + (options["shift_a"] if topic == "/a" else 0)
        name = topic
        if options["remap"] == ("/b/**:=/x/**",):
            name = topic.replace("/b/", "/x/")
        elif options["remap"] and topic == "/a":
            name = "/new/a"
        if not (0 <= each.time + delta < 1 << 64):
            continue
        published = each.published + delta
        data = each.data if value is None else payload(value)
        found.append(
            each._replace(
                topic=name,
                time=each.time + delta,
                published=published if 0 <= published < 1 << 64 else each.time + delta,
                data=data,
            )
        )
    if options["shift_a"]:
        found.sort(key=lambda each: each.time)
    return found


@common
@given(rows, kinds, edits)
def test_any_edit_of_any_log(log, kind, options):
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "in.mcap"), Path(folder, "out.mcap")
        write(path, log, **kind)
        shifts = [str(options["shift"]), f"/a={options['shift_a'] / 1e9}"]
        wanted = {name: options[name] for name in options if not name.startswith("shift")}
        try:
            result = edit(EditOptions(inputs=[path], output=out, shifts=shifts, **wanted))
        except ConfigError as error:
            problem = str(error)
        else:
            problem = ""
        if problem:  # fields of no message could be read
            assert "not JSON" in problem
            assert None in [value for _, _, value, _ in log]
            assert not out.exists()
            return
        only_b = options["keep"] == ("/b/**",)
        delta_a = 0 if only_b else options["shift_a"]
        before = raw(path, complete=False)
        right = expected(before, {**options, "shift_a": delta_a}, by_time=options["sort"] or delta_a != 0)
        assert raw(out) == right
        total = result.total()
        assert (total.read, total.kept) == (len(before), len(right))
        assert sum(result.unwritable.values()) <= total.dropped
        assert not result.losses


keys = st.sampled_from(["a", "b/c", "0/x/std_msgs::msg::dds_::String_/TypeHashNotSupported"])
messages = st.builds(
    Message,
    time=st.integers(0, 60) | st.integers(0, 2**62),
    key=keys,
    payload=st.binary(max_size=40),
    kind=st.sampled_from(["put", "delete"]),
    encoding=st.sampled_from(["", "application/json", "text/plain;x"]),
    attachment=st.none() | st.binary(max_size=40),
    qos=st.builds(Qos, st.integers(1, 7), st.sampled_from(["drop", "block", "block_first"]), st.booleans()),
    segment=st.sampled_from(["", "inside"]),
    sequence=st.integers(0, 2**32 - 1) | st.integers(0, 2**63 - 1),
    publish_time=st.none() | st.integers(0, 60) | st.integers(-(2**63), 2**64 - 1),
)
roles = st.sampled_from(["delivered", "original"])
notes = st.lists(
    st.builds(Change, st.text(max_size=4), st.just("set"), st.none(), st.integers(), st.text(max_size=3)), max_size=1
)
own_logs = st.lists(st.tuples(messages, roles, notes), max_size=15)


def write_own(path: Path, log: list[Any], chunk_bytes: int) -> None:
    with LogWriter(path, LogSettings(chunk_bytes=chunk_bytes), clock=ManualClock(), metadata={"seed": "1"}) as writer:
        for message, role, what in log:
            writer.write(message, role=role, changes=what)


class Passive:
    """Looks at everything and does nothing."""

    def message(self, event: Any) -> None:
        assert event.message.payload == event.payload


@common
@given(st.lists(own_logs, min_size=1, max_size=3), st.integers(1, 500), st.booleans(), st.sampled_from(["", "b/c"]))
def test_logs_of_ours_keep_all_that_they_know(logs, chunk_bytes, piped, without):
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{number}.mcap") for number in range(len(logs))]
        for path, log in zip(paths, logs, strict=True):
            write_own(path, log, chunk_bytes)
        out = Path(folder, "out.mcap")
        there = {message.key for log in logs for message, _, _ in log}
        drop = [without] if without in there else []
        edit(
            EditOptions(inputs=paths, output=out, drop=drop, chunk_bytes=chunk_bytes),
            interceptors=[Passive()] if piped else [],
        )
        raw(out)  # sound, as the library `mcap` sees it
        rest = [[row for row in log if row[0].key not in drop] for log in logs]
        with LogReader(out) as reader:
            for role in ("delivered", "original"):
                kept = [
                    message for log in rest for message, r, _ in sorted(log, key=lambda row: row[0].time) if r == role
                ]
                assert list(reader.messages(role=role)) == sorted(kept, key=lambda message: message.time)  # type: ignore[arg-type]
            noted = [(m.sequence, m.key, m.time, r, tuple(what)) for log in rest for m, r, what in log if what]
            found = [(p.sequence, p.key, p.time, p.role, p.changes) for p in reader.provenance()]
            assert sorted(map(repr, found)) == sorted(map(repr, noted))
            assert reader.metadata == {"seed": "1"}
            assert not reader.loss


@common
@given(own_logs, st.data())
def test_what_is_left_of_a_damaged_log_is_recovered(log, data):
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "in.mcap"), Path(folder, "out.mcap")
        write_own(path, log, 200)
        whole = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(0, 3))):
            whole[data.draw(st.integers(8, len(whole) - 1))] = data.draw(st.integers(0, 255))
        path.write_bytes(whole[: data.draw(st.integers(8, len(whole)))])
        with LogReader(path) as reader:
            left = [list(reader.messages(role=role)) for role in ("delivered", "original")]
            lost = reader.loss
        result = edit(EditOptions(inputs=[path], output=out))
        with LogReader(out) as reader:
            found = [list(reader.messages(role=role)) for role in ("delivered", "original")]
            assert not reader.loss
        if lost:  # where the head of a chunk is damaged, nobody knows its place among messages of the same time
            found, left = ([sorted(each, key=lambda m: (m.time, repr(m))) for each in both] for both in (found, left))
        assert found == left
        assert bool(result.losses) or not lost or lost.unsorted
        (record,) = [mapping for name, mapping in metadata(out) if name == "riot_bus.edit"]
        assert ("lost" in json.loads(record["inputs"])[0]) == bool(result.losses)


def test_declared_lengths_that_are_too_long_do_no_harm(tmp_path):
    path = tmp_path / "in.mcap"
    write(path, [("/a", 10**9 + n, n % 9, n) for n in range(50)], chunk_size=200)
    whole = path.read_bytes()
    at = whole.index(b"zstd")
    for place in (at - 16, at - 40, at + 4):
        damaged = whole[:place] + struct.pack("<Q", 1 << 60) + whole[place + 8 :]
        path.write_bytes(damaged)
        result = edit(EditOptions(inputs=[path], output=tmp_path / f"{place}.mcap"))
        assert result.losses or place > at  # what is compressed ends before what is claimed, and is whole
        assert result.total().kept == len(raw(tmp_path / f"{place}.mcap"))


class Restless:
    """Drops, delays, copies, changes and adds messages, each in its own way."""

    def message(self, event: Any) -> None:
        draw = event.random()
        kind = draw.randrange(8)
        if kind == 0:
            event.drop()
        elif kind == 1:
            event.delay(draw.randrange(40) / 1e9)
        elif kind == 2:
            event.duplicate(draw.randrange(1, 3))
        elif kind == 3:
            event.replace(b"replaced")
        elif kind == 4:
            for n in range(2):
                event.add(Message(3, "b/c", b"added %d" % n, attachment=b"x"), seconds=draw.randrange(20) / 1e9)
        elif kind == 5:
            event.message = event.message.with_(key="a", segment="elsewhere", kind="delete")
            event.delay(draw.randrange(3) / 1e9)


plain = st.builds(
    Message,
    time=st.integers(0, 60),
    key=keys,
    payload=st.binary(max_size=5),
    attachment=st.none() | st.binary(max_size=5),
    segment=st.sampled_from(["", "inside"]),
    sequence=st.integers(0, 2**33),
    publish_time=st.none() | st.integers(0, 60),
)


@common
@given(st.lists(st.lists(plain, max_size=12), min_size=1, max_size=3), st.integers(1, 300))
def test_interceptors_do_the_same_as_when_the_logs_are_played(logs, chunk_bytes):
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        paths = [Path(folder, f"{number}.mcap") for number in range(len(logs))]
        for path, log in zip(paths, logs, strict=True):
            write_own(path, [(message, "delivered", []) for message in log], chunk_bytes)
        readers = [stack.enter_context(LogReader(path)) for path in paths]
        merged = MergedSource([LogSource(reader) for reader in readers])
        pipeline = Pipeline([Restless()], registry=TypeRegistry(load_adapters()), start=merged.start)
        played = list(PipedSource(merged, pipeline).messages())
        out = Path(folder, "out.mcap")
        result = edit(EditOptions(inputs=paths, output=out), interceptors=[Restless()])
        with LogReader(out) as reader:
            found = list(reader.messages())
        assert found == played
        assert [each.time for each in raw(out)] == [message.time for message in played]
        total = result.total()
        assert total.kept + total.added == len(played)
        assert total.read == total.kept + total.dropped == sum(map(len, logs))
