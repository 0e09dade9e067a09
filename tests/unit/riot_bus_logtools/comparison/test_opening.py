from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.log.account import LOST, Account
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.compare import Wishes
from riot_bus_logtools.comparison.opening import compare_logs, opened, propose_tolerances
from riot_bus_logtools.comparison.options import Extract
from tests.bags import STRING_HASH, STRING_KEY, VOLATILE, text, write_bag
from tests.unit.riot_bus_logtools.comparison.recordings import BEGIN, MS, said

SECOND = 10**9


def write(path: Path, *parts) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with LogWriter(path) as writer:
        for message in sorted((each for part in parts for each in part), key=lambda each: each.time):
            writer.write(message)
    return path


def rows(count=20, **more):
    return [{"n": number, **more} for number in range(count)]


def test_two_files(tmp_path):
    a = write(tmp_path / "a.mcap", said(*rows()), said(*rows(x=1), key="b"))
    b = write(tmp_path / "b.mcap", said(*rows()), said(*rows(x=2), key="b"))
    found = compare_logs(a, b)
    assert [(each.topic, each.same) for each in found.topics] == [("b", False), ("a", True)]
    assert (found.a.name, found.a.messages, found.missing) == (str(a), 40, ())


def test_topics_are_chosen(tmp_path):
    a = write(tmp_path / "a.mcap", said(*rows(), key="r/a"), said(*rows(x=1), key="r/b"))
    b = write(tmp_path / "b.mcap", said(*rows(), key="r/a"), said(*rows(x=2), key="r/b"))
    assert compare_logs(a, b, extract=Extract(topics=["r/a"])).same
    assert compare_logs(a, b, extract=Extract(exclude=["r/b"])).same
    assert not compare_logs(a, b, extract=Extract(topics=["r/*"])).same
    for extract in (Extract(topics=["r/c"]), Extract(exclude=["r/c"])):
        with pytest.raises(ConfigError, match="no log has a topic 'r/c'") as error:
            compare_logs(a, b, extract=extract)
        assert "did you mean" in str(error.value.hint)


def test_a_stretch_of_each(tmp_path):
    a = write(tmp_path / "a.mcap", said(*rows(), period=SECOND))
    b = write(tmp_path / "b.mcap", said(*rows(15), {"n": -1}, *rows(20)[16:], begin=BEGIN + 50 * SECOND, period=SECOND))
    assert not compare_logs(a, b).same
    found = compare_logs(a, b, extract=Extract(start="2", end="15"))
    assert (found.same, found.a.messages) == (True, 13)
    with pytest.raises(ConfigError, match="is no time"):
        compare_logs(a, b, extract=Extract(start="soon"))


def test_a_folder_of_files_is_one_log(tmp_path):
    whole = write(tmp_path / "whole.mcap", said(*rows()))
    messages = said(*rows())
    for number in range(4):
        write(tmp_path / "parts" / f"run_{number}.mcap", messages[number * 5 : number * 5 + 5])
    found = compare_logs(whole, tmp_path / "parts")
    assert (found.same, found.b.messages) == (True, 20)
    with pytest.raises(ConfigError, match="holds no"):
        compare_logs(whole, (tmp_path / "empty").mkdir() or tmp_path / "empty")


def test_a_bag_and_a_recording_of_the_bus(tmp_path):
    bag = write_bag(
        tmp_path / "bag.mcap",
        {"/chatter": (VOLATILE, STRING_HASH)},
        [(BEGIN + number * MS, "/chatter", f"hello {number}") for number in range(5)],
    )
    words = ["hello 0", "hello 1", "hello two", "hello 3", "hello 4"]
    bus = write(
        tmp_path / "bus.mcap",
        [
            Message(BEGIN + n * MS, f"0/chatter/{STRING_KEY}", text(word), attachment=bytes([n]) * 33)
            for n, word in enumerate(words)
        ],
    )
    (topic,) = compare_logs(bag, bus).topics
    assert (topic.topic, topic.type, topic.equal, topic.changed) == ("/chatter", "std_msgs/msg/String", 4, 1)
    assert (topic.fields[0].name, topic.fields[0].example.after) == ("data", "hello two")


def test_what_is_missing_of_logs_is_told(tmp_path):
    a = write(tmp_path / "a.mcap", said(*rows(2000)))
    b = tmp_path / "b.mcap"
    b.write_bytes(a.read_bytes()[:-300])
    found = compare_logs(a, b)
    assert found.missing == (f"{b}: {found.b.missing[0]}",)
    assert "not closed" in found.b.missing[0]
    with LogWriter(tmp_path / "c.mcap") as writer:
        for message in said(*rows(2000)):
            writer.write(message)
        writer.note(LOST, Account({"a": 2000}, {"disk": {"a": 3}}).record())
    assert compare_logs(a, tmp_path / "c.mcap").b.missing == ("3 messages lost when it was recorded",)


def test_logs_that_are_none(tmp_path):
    a = write(tmp_path / "a.mcap", said(*rows()))
    with pytest.raises(ConfigError, match="cannot read the log"):
        compare_logs(a, tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text("hello", encoding="utf-8")
    with pytest.raises(ConfigError, match="not an MCAP file"):
        compare_logs(tmp_path / "text.mcap", a)


def test_types_may_be_declared(tmp_path):
    payloads = [b"\0\1\0\0" + bytes(48), b"\0\1\0\0" + bytes(47) + b"\x3f"]
    a, b = (write(tmp_path / f"{n}.mcap", [Message(BEGIN, "cmd", payload)]) for n, payload in enumerate(payloads))
    assert compare_logs(a, b).topics[0].fields[0].name == "(payload)"
    found = compare_logs(a, b, extract=Extract(types=["cmd=geometry_msgs/msg/Twist"]))
    assert found.topics[0].fields[0].name == "angular.z"


def test_what_is_large_goes_to_a_file(tmp_path, monkeypatch):
    from riot_bus_logtools.comparison import recording

    monkeypatch.setattr(recording, "_IN_MEMORY", 1000)
    a = write(tmp_path / "a.mcap", said(*rows(100, x="a" * 100)))
    b = write(tmp_path / "b.mcap", said(*rows(100, x="b" * 100)))
    assert compare_logs(a, b).topics[0].changed == 100
    with opened([a]) as (one,):
        assert one.tracks["a"].hashes


def test_tolerances_of_logs(tmp_path):
    runs = [write(tmp_path / f"{n}.mcap", said(*rows(x=1.0 + n / 10))) for n in range(3)]
    found = propose_tolerances(runs)
    assert (found.logs, [each.name for each in found.tolerances]) == (tuple(map(str, runs)), ["a:x"])
    assert compare_logs(runs[0], runs[2], Wishes(tolerances=found.given())).same
    with pytest.raises(ConfigError, match="two runs or more"):
        propose_tolerances(runs[:1])
