from pathlib import Path

import pytest

from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.play.options import PlayOptions
from riot_bus.play.playback_plan import PlaybackPlan
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from tests.bags import LATCHED, STRING_HASH, STRING_KEY, VOLATILE, write_bag

MS = 10**6
SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND


def write(path, *messages):
    with LogWriter(path, LogSettings(chunk_bytes=200)) as writer:
        for key, seconds in messages:
            writer.write(Message(BEGIN + int(seconds * SECOND), key, b'{"v": 1}'))
    return path


def played(*logs: Path, **options):
    """Keys and seconds since the beginning of all logs, as they are played."""
    programme = PlaybackPlan(PlayOptions(logs=logs, **options))
    try:
        return [(m.key, (m.time - programme.origin) / SECOND) for m in programme.source.messages()]
    finally:
        programme.close()


def test_logs_are_merged_on_one_time_base(tmp_path):
    one = write(tmp_path / "one.mcap", ("a", 0), ("a", 2))
    two = write(tmp_path / "two.mcap", ("b", 1), ("b", 2))
    assert played(one, two) == [("a", 0), ("b", 1), ("a", 2), ("b", 2)]
    assert played(two, one) == [("a", 0), ("b", 1), ("b", 2), ("a", 2)]
    assert played(one, two, align=True) == [("a", 0), ("b", 0), ("b", 1), ("a", 2)]


def test_a_folder_is_one_recording(tmp_path):
    for number in (0, 1, 10):
        write(tmp_path / f"run_{number}.mcap", ("a", number), ("a", number + 0.5))
    other = write(tmp_path.parent / f"{tmp_path.name}.mcap", ("b", 100))
    times = [0, 0.5, 1, 1.5, 10, 10.5]
    assert played(tmp_path) == [("a", time) for time in times]
    assert played(tmp_path, other, align=True) == [("a", 0), ("b", 0), *[("a", time) for time in times[1:]]]


@pytest.mark.parametrize(
    ("options", "times"),
    [
        ({"start_offset": 1.0}, [1, 2, 3]),
        ({"start_offset": 1.0, "duration": 1.5}, [1, 2]),
        ({"duration": 0.0}, []),
        ({"until": "2"}, [0, 1]),
        ({"until": "100"}, [0, 1, 2, 3]),
        ({"start_offset": 2.0, "until": "3"}, [2]),
        ({"start_offset": 3.0}, [3]),
    ],
)
def test_parts(tmp_path, options, times):
    log = write(tmp_path / "log.mcap", *[("a", time) for time in range(4)])
    assert played(log, **options) == [("a", time) for time in times]


def test_nothing_is_left_of_a_log(tmp_path):
    log = write(tmp_path / "log.mcap", ("a", 0), ("a", 1))
    with pytest.raises(ConfigError, match="the logs are 1 s long"):
        played(log, start_offset=1.5)
    with pytest.raises(ConfigError, match="not after the beginning"):
        played(log, start_offset=0.5, until="0.5")


def test_empty_logs_and_a_log_that_begins_at_zero(tmp_path):
    empty = write(tmp_path / "empty.mcap")
    assert played(empty) == []
    with LogWriter(tmp_path / "zero.mcap") as writer:
        writer.write(Message(0, "a", b""))
    assert played(empty, tmp_path / "zero.mcap") == [("a", 0)]
    assert played(tmp_path / "zero.mcap") == [("a", 0)]


def test_what_is_latched_comes_first_wherever_it_begins(tmp_path):
    topics = {"/map": (LATCHED, STRING_HASH), "/odom": (VOLATILE, STRING_HASH)}
    log = [(BEGIN + number * SECOND, "/map" if number < 4 else "/odom", str(number)) for number in range(8)]
    bag = write_bag(tmp_path / "bag.mcap", topics, log)
    programme = PlaybackPlan(PlayOptions(logs=[bag], domain=0, start_offset=5.0))
    found = [(m.key.split("/")[1], m.payload[8:9], m.time - BEGIN) for m in programme.source.messages()]
    programme.close()
    assert found == [
        ("map", b"2", 5 * SECOND),
        ("map", b"3", 5 * SECOND),
        ("odom", b"5", 5 * SECOND),
        ("odom", b"6", 6 * SECOND),
        ("odom", b"7", 7 * SECOND),
    ]


def test_types_are_known_under_the_keys_that_are_played(tmp_path):
    bag = write_bag(tmp_path / "bag.mcap", {"/chatter": (VOLATILE, STRING_HASH)}, [(BEGIN, "/chatter", "hello")])
    programme = PlaybackPlan(PlayOptions(logs=[bag], remap=["/chatter:=/replay"], domain=0))
    (message,) = programme.source.messages()
    programme.close()
    assert message.key == f"0/replay/{STRING_KEY}"
    kind = programme.registry.type_of(message.key)
    assert kind.read(message.payload, "data") == "hello"
    assert programme.name(message.key) == "/replay"


def test_interceptors_work_on_what_is_played(tmp_path):
    log = write(tmp_path / "log.mcap", ("a", 0), ("b", 1), ("a", 2))
    assert played(log, interceptors=["drop select=a"]) == [("b", 1)]
    assert played(log, interceptors=["delay select=a seconds=1.5"]) == [("b", 1), ("a", 1.5), ("a", 3.5)]
    programme = PlaybackPlan(PlayOptions(logs=[log], interceptors=["drop select=c"]))
    programme.close()
    assert programme.warnings == ["nothing is played on 'c', which an interceptor wants; known: a, b"]


def test_what_could_not_be_read_is_told(tmp_path):
    log = write(tmp_path / "log.mcap", *[("a", time) for time in range(100)])
    log.write_bytes(log.read_bytes()[:-300])
    programme = PlaybackPlan(PlayOptions(logs=[log]))
    list(programme.source.messages())
    programme.finish()
    assert set(programme.losses()) == {str(log)}
    assert "the file was not closed" in programme.losses()[str(log)]
    programme.close()


def test_bad_logs_are_refused_and_the_others_closed(tmp_path):
    log = write(tmp_path / "log.mcap", ("a", 0))
    with pytest.raises(ConfigError, match="cannot read the log"):
        played(log, tmp_path / "none.mcap")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ConfigError, match=r"holds no \.mcap files"):
        played(tmp_path / "folder")
