"""What an edit does to logs, as the library `mcap` and our own reader see it."""

import json
import struct

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from riot_bus.interceptors.losses import Drop
from riot_bus.interceptors.timing import Delay
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.layout import Provenance
from riot_bus.log.reader import LogReader, read_log
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.pipeline.event import Change
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_mavlink.frame import pack_frame
from tests.unit.riot_bus_logtools.editing.edit_tools import (
    BEGIN,
    SECOND,
    bag,
    cdr,
    chunk_sizes,
    counts,
    json_log,
    metadata,
    numbers,
    raw,
    run,
    topic,
)


def test_a_log_without_edits_is_copied_chunk_by_chunk(tmp_path):
    log = bag(tmp_path / "in.mcap", numbers(100))
    result = run(log, tmp_path / "out.mcap")
    assert raw(tmp_path / "out.mcap") == raw(log)
    assert chunk_sizes(tmp_path / "out.mcap") == chunk_sizes(log)
    assert counts(result) == {"/a": (50, 0, 0), "/b": (50, 0, 0)}
    assert [(each.path, each.messages) for each in result.files] == [(str(tmp_path / "out.mcap"), 100)]
    assert result.files[0].size == (tmp_path / "out.mcap").stat().st_size


def test_our_own_log_keeps_attachments_notes_and_metadata(tmp_path):
    path = tmp_path / "in.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=300), metadata={"seed": "7"}) as writer:
        for n in range(40):
            message = Message(BEGIN + n, "a/b", b'{"v": 1}', attachment=b"%d" % n, sequence=n + (1 << 40))
            writer.write(message, role="original")
            writer.write(message.with_payload(b'{"v": 2}'), changes=[Change("i", "set", "v", 1, 2)])
        writer.note("riot_bus.graph", {"whole": "true"})
    out = tmp_path / "out.mcap"
    result = run(path, out)
    with LogReader(path) as before, LogReader(out) as after:
        assert list(after.messages()) == list(before.messages())
        assert list(after.originals()) == list(before.originals())
        assert list(after.provenance()) == list(before.provenance())
        assert after.metadata == {"seed": "7"}
        assert list(after.notes("riot_bus.graph")) == [{"whole": "true"}]
        assert not after.loss
    assert topic(result, "a/b").originals == 40


def test_the_record_of_the_edit(tmp_path):
    log = json_log(tmp_path / "in.mcap", 10)
    run(log, tmp_path / "out.mcap", drop=["b"], changes=["a:v = 1"])
    (found,) = [mapping for name, mapping in metadata(tmp_path / "out.mcap") if name == "riot_bus.edit"]
    assert json.loads(found["inputs"]) == [{"name": "in.mcap", "size": log.stat().st_size}]
    assert json.loads(found["steps"]) == {"drop": ["b"], "set": ["a:v = 1"]}
    assert json.loads(found["messages"])["a"] == {"kept": 5, "changed": 5, "dropped": 0, "added": 0}
    assert found["riot_bus"]
    run(tmp_path / "out.mcap", tmp_path / "again.mcap")
    assert [name for name, _ in metadata(tmp_path / "again.mcap")].count("riot_bus.edit") == 2


def test_the_same_edit_makes_the_same_bytes(tmp_path):
    log = json_log(tmp_path / "in.mcap", 100)
    for name in ("one", "two"):
        run(log, tmp_path / f"{name}.mcap", changes=["a:v += 1"], compression="lz4")
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"keep": ["/a"]}, [0, 2, 4, 6, 8]),
        ({"drop": ["/a"]}, [1, 3, 5, 7, 9]),
        ({"keep": ["*"]}, list(range(10))),
        ({"keep": ["/a where x > 3"]}, [4, 6, 8]),
        ({"keep": ["/a where x > 3", "/b index 1"]}, [3, 4, 6, 8]),
        ({"keep": ["/a", "/a where x > 3"]}, [0, 2, 4, 6, 8]),
        ({"drop": ["** where x >= 2 and x < 9"]}, [0, 1, 9]),
        ({"drop": ["/a every 2", "/b during 0.2..0.6"]}, [1, 2, 6, 7, 9]),
        ({"keep": ["**"], "drop": ["/b"]}, [0, 2, 4, 6, 8]),
        ({"start": "0.3", "end": "0.7"}, [3, 4, 5, 6]),
        ({"start": "0.3", "duration": 0.2}, [3, 4]),
        ({"duration": 0.2}, [0, 1]),
        ({"start": str(BEGIN / SECOND + 0.7)}, [7, 8, 9]),
        ({"start": "0.3", "keep": ["** index 0"]}, [3, 4]),
    ],
)
@pytest.mark.parametrize("sort", [False, True])
def test_choosing(tmp_path, options, expected, sort):
    log = bag(tmp_path / "in.mcap", numbers(10), chunk_size=150)
    result = run(log, tmp_path / "out.mcap", sort=sort, **options)
    before = raw(log)
    assert raw(tmp_path / "out.mcap") == [before[n] for n in expected]
    total = result.total()
    assert (total.read, total.kept, total.dropped) == (10, len(expected), 10 - len(expected))
    dry = run(log, tmp_path / "none.mcap", sort=sort, dry_run=True, **options)
    assert dry.topics == result.topics
    assert dry.files == []
    assert not (tmp_path / "none.mcap").exists()


def test_topics_of_which_nothing_is_kept_are_not_in_the_output(tmp_path):
    log = bag(tmp_path / "in.mcap", numbers(10))
    run(log, tmp_path / "out.mcap", drop=["/b"])
    with LogReader(tmp_path / "out.mcap") as reader:
        assert set(reader.schemas) == {"/a"}


def test_setting_fields_leaves_all_else_as_it_is(tmp_path):
    pytest.importorskip("rosbags")
    rows = numbers(20)
    log = bag(tmp_path / "in.mcap", rows)
    result = run(log, tmp_path / "out.mcap", changes=["/a:x = nan where x > 5", "/a:x += 1 where x < 5"])
    before, after = raw(log), raw(tmp_path / "out.mcap")
    for n, (old, new) in enumerate(zip(before, after, strict=True)):
        if n % 2:
            assert new == old
        else:
            x = float("nan") if n > 5 else n + 1.0
            assert new == old._replace(data=cdr(x)) or (n > 5 and new.data == cdr(float("nan")))
    assert counts(result) == {"/a": (10, 10, 0), "/b": (10, 0, 0)}


def test_assignments_are_carried_out_in_their_order(tmp_path):
    log = json_log(tmp_path / "in.mcap", 4)
    run(log, tmp_path / "out.mcap", changes=["a:v = 2", "a:v *= 10", "a:v += 1"])
    assert [m.payload for m in read_log(tmp_path / "out.mcap") if m.key == "a"] == [b'{"v": 21}', b'{"v": 21}']


def test_a_value_that_changes_nothing_is_no_change(tmp_path):
    log = json_log(tmp_path / "in.mcap", 4)
    assert counts(run(log, tmp_path / "out.mcap", changes=["a:v *= 1"])) == {"a": (2, 0, 0), "b": (2, 0, 0)}


def test_strings_of_another_length(tmp_path):
    pytest.importorskip("rosbags")
    log = bag(tmp_path / "in.mcap", numbers(6))
    run(log, tmp_path / "out.mcap", changes=["/a:name = 'much longer than before'"])
    data = [each.data for each in raw(tmp_path / "out.mcap") if each.topic == "/a"]
    assert data == [cdr(float(n), name="much longer than before") for n in (0, 2, 4)]


def test_messages_that_cannot_be_changed_stay_and_are_told(tmp_path):
    path = tmp_path / "in.mcap"
    with LogWriter(path) as writer:
        for n in range(6):
            writer.write(Message(n, "a", b'{"v": 1}' if n % 2 else b"\xff{", encoding="application/json"))
    result = run(path, tmp_path / "out.mcap", changes=["a:v = 2"])
    assert [m.payload for m in read_log(tmp_path / "out.mcap")] == [b"\xff{", b'{"v": 2}'] * 3
    (warning,) = result.warnings
    assert "--set 'a:v = 2': 3 messages are left as they are" in warning


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"changes": ["a:w = 1"]}, "no field 'w'"),
        ({"keep": ["a where w > 1"]}, "no field 'w'"),
        ({"changes": ["a:v += 1 where v.x > 1"]}, "v.x"),
        ({"keep": ["odom"]}, "no topic 'odom'"),
        ({"drop": ["aa"]}, "no topic 'aa'"),
        ({"changes": ["aa:v = 1"]}, "no topic 'aa'"),
        ({"shifts": ["aa=1"]}, "no topic 'aa'"),
        ({"remap": ["aa:=c"]}, "no topic 'aa'"),
        ({"remap": ["a:=c*"]}, "cannot be the name of a topic"),
        ({"remap": ["a"]}, "does not say what to rename"),
        ({"shifts": ["a=x"]}, "how far in seconds"),
        ({"start": "5", "end": "4"}, "not after"),
        ({"start": "x"}, "no time"),
        ({"end": "4", "duration": 3.0}, "choose one"),
        ({"duration": 0.0}, "above 0"),
        ({"compression": "zip"}, "unknown compression"),
        ({"split_bytes": 0}, "at least 1 byte, not 0"),
    ],
)
def test_mistakes_are_explained_and_nothing_is_written(tmp_path, options, problem):
    log = json_log(tmp_path / "in.mcap", 10)
    with pytest.raises(ConfigError) as caught:
        run(log, tmp_path / "out.mcap", **options)
    assert problem in str(caught.value)
    assert [each.name for each in tmp_path.iterdir()] == ["in.mcap"]


def test_times_are_shifted(tmp_path):
    log = bag(tmp_path / "in.mcap", numbers(10))
    run(log, tmp_path / "out.mcap", shifts=["-0.5"])
    delta = SECOND // 2
    expected = [each._replace(time=each.time - delta, published=each.published - delta) for each in raw(log)]
    assert raw(tmp_path / "out.mcap") == expected


def test_one_topic_is_shifted_and_takes_its_place_by_time(tmp_path):
    log = bag(tmp_path / "in.mcap", numbers(40), chunk_size=200)
    run(log, tmp_path / "out.mcap", shifts=["/a=1.05", "/a=-0.5"])
    delta = SECOND * 55 // 100
    moved = [
        each._replace(time=each.time + delta, published=each.published + delta) if each.topic == "/a" else each
        for each in raw(log)
    ]
    assert raw(tmp_path / "out.mcap") == sorted(moved, key=lambda each: each.time)


def test_unknown_and_equal_publish_times_stay_what_they_are(tmp_path):
    path = tmp_path / "in.mcap"
    messages = [
        Message(10 + n, "a", b"x", publish_time=published) for n, published in enumerate([None, 11, 5, -7, 1 << 65])
    ]
    with LogWriter(path) as writer:
        for message in messages:
            writer.write(message)
    run(path, tmp_path / "out.mcap", shifts=["2"])
    shift = 2 * SECOND
    assert list(read_log(tmp_path / "out.mcap")) == [
        each.with_(
            time=each.time + shift, publish_time=None if each.publish_time is None else each.publish_time + shift
        )
        for each in messages
    ]


def test_times_outside_of_what_a_log_can_hold(tmp_path):
    log = bag(tmp_path / "in.mcap", [("/a", 5, b"1"), ("/a", 2 * SECOND, b"2"), ("/b", (1 << 64) - 1, b"3")])
    result = run(log, tmp_path / "out.mcap", shifts=["/a=-1", "/b=1"])
    assert [(each.time, each.published) for each in raw(tmp_path / "out.mcap")] == [(SECOND, SECOND - 5)]
    assert result.unwritable == {"/a": 1, "/b": 1}
    assert counts(result) == {"/a": (1, 0, 1), "/b": (0, 0, 1)}


def test_topics_are_renamed(tmp_path):
    log = bag(tmp_path / "in.mcap", numbers(10, ("/robot/a", "/robot/b", "/c")))
    result = run(log, tmp_path / "out.mcap", remap=["/robot/**:=/x/y/**", "/c:=d"])
    names = {"/robot/a": "/x/y/a", "/robot/b": "/x/y/b", "/c": "/d"}
    assert raw(tmp_path / "out.mcap") == [each._replace(topic=names[each.topic]) for each in raw(log)]
    assert {each.topic: each.written_as for each in result.topics} == names


def test_keys_are_renamed(tmp_path):
    log = json_log(tmp_path / "in.mcap", 10, ("robot/a", "b"))
    run(log, tmp_path / "out.mcap", remap=["robot/**:=r/**"])
    keys = {"robot/a": "r/a", "b": "b"}
    assert list(read_log(tmp_path / "out.mcap")) == [each.with_(key=keys[each.key]) for each in read_log(log)]


def test_keys_of_ros_topics_are_renamed_with_domain_type_and_hash(tmp_path):
    pytest.importorskip("rosbags")
    from riot_bus_ros2.adapter import Ros2Adapter

    path = tmp_path / "in.mcap"
    tail = "std_msgs::msg::dds_::String_/RIHS01_" + "0" * 64
    with LogWriter(path, registry=TypeRegistry([Ros2Adapter()])) as writer:
        writer.write(Message(1, f"7/chatter/{tail}", b"x", attachment=bytes(33)), role="original")
        writer.write(
            Message(1, f"7/chatter/{tail}", b"y", attachment=bytes(33)), changes=[Change("i", "set", None, 1, 2)]
        )
    run(path, tmp_path / "out.mcap", remap=["/chatter:=/robot/talk"])
    with LogReader(tmp_path / "out.mcap") as reader:
        assert [m.key for m in reader.messages()] == [f"7/robot/talk/{tail}"]
        assert [m.key for m in reader.originals()] == [f"7/robot/talk/{tail}"]
        assert [p.key for p in reader.provenance()] == [f"7/robot/talk/{tail}"]
        assert list(reader.schemas) == ["/robot/talk"]
    assert [each.topic for each in raw(tmp_path / "out.mcap")] == ["riot/original/robot/talk", "/robot/talk"]


def test_originals_follow_topic_and_time_alone(tmp_path):
    path = tmp_path / "in.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=200)) as writer:
        for n in range(20):
            message = Message(n * SECOND, "ab"[n % 2], b'{"v": %d}' % n, sequence=n)
            writer.write(message, role="original")
            writer.write(message, changes=[Change("i", "delay", None, None, 0.5)])
    out = tmp_path / "out.mcap"
    run(path, out, start="4", end="16", drop=["b", "a where v > 8"], changes=["a:v = 0"])
    with LogReader(out) as reader:
        assert [m.sequence for m in reader.messages()] == [4, 6, 8]
        assert {m.payload for m in reader.messages()} == {b'{"v": 0}'}
        assert [m.payload for m in reader.originals()] == [b'{"v": %d}' % n for n in range(4, 16, 2)]
        assert [p.sequence for p in reader.provenance()] == [4, 6, 8]
    run(path, tmp_path / "without.mcap", originals=False)
    with LogReader(tmp_path / "without.mcap") as reader:
        assert list(reader.originals()) == []
        assert len(list(reader.messages())) == 20


def test_logs_are_merged_by_time(tmp_path):
    one = bag(tmp_path / "one.mcap", [("/a", n * 10, b"a%d" % n) for n in range(50)], chunk_size=200)
    two = bag(tmp_path / "two.mcap", [("/b", n * 7, b"b%d" % n) for n in range(70)], chunk_size=300)
    run([one, two], tmp_path / "out.mcap")
    expected = sorted(raw(one) + raw(two), key=lambda each: each.time)  # stable: of equal times, the first log's
    assert raw(tmp_path / "out.mcap") == expected


def test_logs_are_merged_on_one_time_base(tmp_path):
    one = bag(tmp_path / "one.mcap", [("/a", 100 + n, b"a") for n in range(3)])
    two = bag(tmp_path / "two.mcap", [("/b", 5000 + n, b"b") for n in range(3)])
    run([two, one], tmp_path / "out.mcap", align=True)
    found = [(each.topic, each.time, each.published) for each in raw(tmp_path / "out.mcap")]
    assert found == [(name, 100 + n, 95 + n) for n in range(3) for name in ("/b", "/a")]


def test_merged_channels_are_one_if_they_say_the_same(tmp_path):
    one = bag(tmp_path / "one.mcap", [("/a", 1, b"1"), ("/b", 2, b"2")])
    two = bag(tmp_path / "two.mcap", [("/b", 3, b"3"), ("/a", 4, b"4")])
    run([one, two], tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert sorted(channel.topic for channel in summary.channels.values()) == ["/a", "/b"]
    assert len(summary.schemas) == 1
    assert raw(tmp_path / "out.mcap") == raw(one) + raw(two)


def test_a_split_recording_is_joined_by_copying(tmp_path):
    rows = numbers(200)
    parts = [bag(tmp_path / f"{n}.mcap", rows[n * 50 : n * 50 + 50]) for n in range(4)]
    run(parts, tmp_path / "out.mcap", chunk_bytes=1000)
    assert raw(tmp_path / "out.mcap") == [each for part in parts for each in raw(part)]
    for sizes in (chunk_sizes(part) for part in parts):
        assert set(sizes[1:]) <= set(chunk_sizes(tmp_path / "out.mcap"))


def test_chunks_of_several_logs_are_not_mixed_up(tmp_path):
    """The chunks of one log come between those of another, with the same numbers and the same channels."""
    logs = []
    for name in range(3):
        rows = [
            ("/a", 1000 * (3 * n + name) + step, b"%d %d %d" % (name, n, step)) for n in range(6) for step in range(9)
        ]
        logs.append(bag(tmp_path / f"{name}.mcap", rows, chunk_size=9 * (31 + 5) + 200))
    run(logs, tmp_path / "out.mcap", chunk_bytes=300)
    expected = sorted((each for log in logs for each in raw(log)), key=lambda each: each.time)
    assert raw(tmp_path / "out.mcap") == expected


def test_of_several_runs_the_first_one_counts(tmp_path):
    for name in ("one", "two"):
        with LogWriter(tmp_path / f"{name}.mcap", metadata={"seed": name, name: "1"}) as writer:
            writer.write(Message(1, "a", b"x"))
    run([tmp_path / "one.mcap", tmp_path / "two.mcap"], tmp_path / "out.mcap")
    with LogReader(tmp_path / "out.mcap") as reader:
        assert reader.metadata == {"seed": "one", "one": "1", "two": "1"}


def test_what_recorders_have_lost_is_told_of_the_topics_that_are_kept(tmp_path):
    for name, lost in (("one", {"a": 3, "b": 5}), ("two", {"a": 4})):
        with LogWriter(tmp_path / f"{name}.mcap") as writer:
            writer.note(LOST, Account(recorded={"a": 1}).record())
            writer.write(Message(1, "a", b"x"))
            writer.write(Message(1, "b", b"x"))
            writer.note(LOST, Account({"a": 9, "b": 9}, {"disk": lost}, {"paused": {"b": 1}}).record())
    run([tmp_path / "one.mcap", tmp_path / "two.mcap"], tmp_path / "out.mcap", drop=["b"], remap=["a:=c"])
    with LogReader(tmp_path / "out.mcap") as reader:
        (note,) = reader.notes(LOST)
    assert account_of(note) == Account({"c": 18}, {"disk": {"c": 7}}, {})


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_compression(tmp_path, compression):
    log = bag(tmp_path / "in.mcap", numbers(100), compression=CompressionType.LZ4)
    run(log, tmp_path / "out.mcap", compression=compression, chunk_bytes=2000)
    assert raw(tmp_path / "out.mcap") == raw(log)
    assert {name for name, _ in chunk_sizes(tmp_path / "out.mcap")} == {compression.replace("none", "")}
    run(log, tmp_path / "same.mcap", drop=["/b"])
    assert {name for name, _ in chunk_sizes(tmp_path / "same.mcap")} == {"lz4"}


def test_attachments_of_others_stay(tmp_path):
    path = tmp_path / "in.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        writer.add_attachment(5, 6, "map.png", "image/png", b"pixels")
        writer.add_metadata("robot", {"name": "r2"})
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    run(path, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as file:
        (found,) = make_reader(file).iter_attachments()
    assert (found.create_time, found.log_time, found.name, found.media_type, found.data) == (
        5,
        6,
        "map.png",
        "image/png",
        b"pixels",
    )
    assert ("robot", {"name": "r2"}) in metadata(tmp_path / "out.mcap")


def test_the_order_of_an_unsorted_file_is_kept_unless_it_shall_be_sorted(tmp_path):
    times = [(n * 7919) % 101 for n in range(200)]
    log = bag(tmp_path / "in.mcap", [("/a" if n % 3 else "/b", time, b"%d" % n) for n, time in enumerate(times)])
    run(log, tmp_path / "out.mcap", drop=["/a index 3"])
    before = raw(log)
    expected = [each for n, each in enumerate(before) if n != 5]
    assert raw(tmp_path / "out.mcap") == [each for each in before if each.data != b"5"] == expected
    run(log, tmp_path / "sorted.mcap", sort=True)
    assert raw(tmp_path / "sorted.mcap") == sorted(before, key=lambda each: each.time)


def test_files_without_chunks(tmp_path):
    log = bag(tmp_path / "in.mcap", numbers(50), use_chunking=False)
    run(log, tmp_path / "out.mcap", drop=["/b every 2"])
    dropped = [each for each in raw(log) if each.topic == "/b"][::2]
    assert raw(tmp_path / "out.mcap") == [each for each in raw(log) if each not in dropped]


def test_an_empty_log(tmp_path):
    log = bag(tmp_path / "in.mcap", [])
    result = run(log, tmp_path / "out.mcap", keep=["/a"], start="3")
    assert raw(tmp_path / "out.mcap") == []
    assert result.total().kept == 0


class TestPipeline:
    def test_interceptors_see_messages_in_the_order_of_time(self, tmp_path):
        seen = []

        class Look:
            def message(self, event):
                seen.append((event.topic, event.index, round(event.seconds, 3)))

        log = bag(tmp_path / "in.mcap", numbers(40)[::-1], chunk_size=100)
        run(log, tmp_path / "out.mcap", [Look()])
        assert seen == [("/ab"[:1] + "ab"[n % 2], n // 2, n / 10) for n in range(40)]
        assert raw(tmp_path / "out.mcap") == sorted(raw(log), key=lambda each: each.time)

    def test_what_they_do(self, tmp_path):
        class Four:
            def message(self, event):
                value = event.read("v")
                if value == 1:
                    event.drop()
                elif value == 2:
                    event.set("v", 20)
                elif value == 3:
                    event.delay(0.25)
                elif value == 4:
                    event.duplicate(2)
                elif value == 5:
                    event.add(Message(0, "new/key", b"{}", encoding="application/json", sequence=77), seconds=0.1)
                elif value == 6:
                    event.message = event.message.with_(key="b")

        log = json_log(tmp_path / "in.mcap", 10, ("a", "b", "c"))
        out = tmp_path / "out.mcap"
        result = run(log, out, [Four()])
        tenth = SECOND // 10
        found = [(m.key, m.payload, (m.time - BEGIN) // (tenth // 2)) for m in read_log(out)]
        assert found == [
            ("a", b'{"v": 0}', 0),
            ("c", b'{"v": 20}', 4),
            ("b", b'{"v": 4}', 8),
            ("b", b'{"v": 4}', 8),
            ("b", b'{"v": 4}', 8),
            ("c", b'{"v": 5}', 10),
            ("a", b'{"v": 3}', 11),
            ("new/key", b"{}", 12),
            ("b", b'{"v": 6}', 12),
            ("b", b'{"v": 7}', 14),
            ("c", b'{"v": 8}', 16),
            ("a", b'{"v": 9}', 18),
        ]
        assert [m.attachment for m in read_log(out) if m.payload in (b'{"v": 3}', b'{"v": 6}')] == [b"3", b"6"]
        assert counts(result) == {"a": (4, 2, 0), "b": (2, 0, 1), "c": (3, 1, 0), "new/key": (0, 0, 0)}
        assert {each.topic: each.added for each in result.topics} == {"a": 0, "b": 2, "c": 0, "new/key": 1}
        with LogReader(out) as reader:
            notes = {(p.sequence, p.key): [c.action for c in p.changes] for p in reader.provenance()}
        assert notes == {
            (2, "c"): ["set"],
            (3, "a"): ["delay"],
            (4, "b"): ["duplicate"],
            (77, "new/key"): ["add"],
            (5, "c"): ["add"],
            (6, "b"): ["replace"],
        }

    def test_what_they_leave_alone_keeps_its_bytes(self, tmp_path):
        class Nothing:
            def message(self, event):
                event.message  # noqa: B018 - to look at it is no change

        log = bag(tmp_path / "in.mcap", numbers(30))
        run(log, tmp_path / "out.mcap", [Nothing()])
        assert raw(tmp_path / "out.mcap") == raw(log)
        with LogWriter(tmp_path / "own.mcap", LogSettings(chunk_bytes=100)) as writer:
            for n in range(9):
                message = Message(n, "a", b"x", attachment=b"%d" % n, segment="s" * n, publish_time=n, sequence=n)
                writer.write(message, changes=[Change("before", "set", "f", 1, 2)])
        run(tmp_path / "own.mcap", tmp_path / "own_out.mcap", [Nothing()])
        assert read_log(tmp_path / "own_out.mcap") == read_log(tmp_path / "own.mcap")
        with LogReader(tmp_path / "own_out.mcap") as reader:
            assert list(reader.provenance()) == [
                Provenance(n, "a", n, "delivered", (Change("before", "set", "f", 1, 2),)) for n in range(9)
            ]

    def test_foreign_messages_that_are_delayed_and_changed(self, tmp_path):
        pytest.importorskip("rosbags")

        class Later:
            topics = ("/a",)

            def message(self, event):
                event.set("x", -1.0)
                event.delay(0.05)

        log = bag(tmp_path / "in.mcap", numbers(20), chunk_size=200)
        result = run(log, tmp_path / "out.mcap", [Later()])
        expected = [
            each._replace(time=each.time + SECOND // 20, data=cdr(-1.0)) if each.topic == "/a" else each
            for each in raw(log)
        ]
        assert raw(tmp_path / "out.mcap") == sorted(expected, key=lambda each: each.time)
        assert counts(result) == {"/a": (10, 10, 0), "/b": (10, 0, 0)}

    def test_with_selection_shift_and_remap_before_and_after(self, tmp_path):
        log = json_log(tmp_path / "in.mcap", 20)
        result = run(
            log,
            tmp_path / "out.mcap",
            [Drop(every=2), Delay(0.01)],
            keep=["a"],
            changes=["a:v += 100"],
            shifts=["a=-1"],
            remap=["a:=z"],
        )
        expected = [(BEGIN + n * SECOND // 10 - SECOND + SECOND // 100, n + 100) for n in range(0, 20, 4)]
        assert [(m.time, json.loads(m.payload)["v"]) for m in read_log(tmp_path / "out.mcap")] == expected
        assert {m.key for m in read_log(tmp_path / "out.mcap")} == {"z"}
        assert counts(result) == {"a": (5, 5, 5), "b": (0, 0, 10)}

    def test_what_was_dropped_before_may_come_again_from_an_interceptor(self, tmp_path):
        class Move:
            def message(self, event):
                event.message = event.message.with_(key="b" if event.index % 2 else "new")

        log = json_log(tmp_path / "in.mcap", 8)
        result = run(log, tmp_path / "out.mcap", [Move()], keep=["a"], remap=["b:=c"])
        keys = ["new", "c"] * 2
        expected = [each.with_(key=key) for each, key in zip(read_log(log)[::2], keys, strict=True)]
        assert list(read_log(tmp_path / "out.mcap")) == expected
        assert counts(result) == {"a": (4, 4, 0), "b": (0, 0, 4), "new": (0, 0, 0)}

    def test_several_messages_that_come_at_the_same_time_keep_their_order(self, tmp_path):
        class Add:
            def message(self, event):
                for n in range(3):
                    event.add(Message(0, "added", b"%d.%d" % (event.index, n)), seconds=0.15)

        log = json_log(tmp_path / "in.mcap", 4, ("a",))
        result = run(log, tmp_path / "out.mcap", [Add()])
        added = [m for m in read_log(tmp_path / "out.mcap") if m.key == "added"]
        assert [m.payload for m in added] == [b"%d.%d" % (n, k) for n in range(4) for k in range(3)]
        assert [(m.time - BEGIN) * 100 // SECOND for m in added] == [n * 10 + 15 for n in range(4) for _ in range(3)]
        assert topic(result, "added").added == 12

    def test_delays_beyond_the_end_of_time(self, tmp_path):
        path = bag(tmp_path / "in.mcap", [("/a", (1 << 64) - SECOND, b"1"), ("/a", (1 << 64) - 1, b"2")])
        result = run(path, tmp_path / "out.mcap", [Delay(0.5)])
        assert [each.data for each in raw(tmp_path / "out.mcap")] == [b"1"]
        assert result.unwritable == {"/a": 1}
        assert counts(result) == {"/a": (1, 1, 1)}

    def test_an_interceptor_that_raises_is_told(self, tmp_path):
        class Broken:
            def message(self, event):
                raise RuntimeError("oops")

        log = json_log(tmp_path / "in.mcap", 5)
        result = run(log, tmp_path / "out.mcap", [Broken()])
        assert read_log(tmp_path / "out.mcap") == read_log(log)
        assert "Broken raised 5 times" in result.warnings[0]

    def test_an_interceptor_that_sees_nothing_is_told(self, tmp_path):
        class Elsewhere:
            topics = ("nothing",)

            def message(self, event):
                raise AssertionError

        log = json_log(tmp_path / "in.mcap", 5)
        assert run(log, tmp_path / "out.mcap", [Elsewhere()]).warnings == ["no interceptor saw a message"]


def test_messages_of_mavlink_are_named_by_short_names(tmp_path):
    rows = [("1/1", 0, 30), ("1/1", 1, 0), ("255/190", 2, 0), ("1/1", 3, 30)]
    bodies = {0: bytes(9), 30: struct.pack("<I6f", 1, 0.5, 0, 0, 0, 0, 0)}
    with LogWriter(tmp_path / "in.mcap") as writer:
        for source, number, kind in rows:
            system, component = map(int, source.split("/"))
            extra, name = {0: (50, "HEARTBEAT"), 30: (39, "ATTITUDE")}[kind]
            payload = pack_frame(
                kind, bodies[kind], extra, version=2, sequence=number, system=system, component=component
            )
            writer.write(Message(BEGIN + number, f"mavlink_raw/fc/{source}/{name}", payload, sequence=number + 1))
    result = run(
        tmp_path / "in.mcap",
        tmp_path / "out.mcap",
        drop=["255/*/HEARTBEAT"],
        changes=["ATTITUDE:roll = 2 where roll > 0", "1/1/HEARTBEAT:type = 6"],
        shifts=["ATTITUDE=1"],
    )
    assert counts(result) == {
        "mavlink_raw/fc/1/1/ATTITUDE": (2, 2, 0),
        "mavlink_raw/fc/1/1/HEARTBEAT": (1, 1, 0),
        "mavlink_raw/fc/255/190/HEARTBEAT": (0, 0, 1),
    }
    registry = TypeRegistry(load_adapters())
    found = [
        (registry.type_of(message.key).read(message.payload, field), message.time - BEGIN)
        for message in read_log(tmp_path / "out.mcap")
        for field in (["roll"] if message.key.endswith("ATTITUDE") else ["type"])
    ]
    assert sorted(found) == [(2.0, SECOND), (2.0, SECOND + 3), (6, 1)]
    with pytest.raises(ConfigError, match="no topic 'SYS_STATUS'"):
        run(tmp_path / "in.mcap", tmp_path / "none.mcap", drop=["SYS_STATUS"])
