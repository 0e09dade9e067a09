from __future__ import annotations

import pytest

from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.recording import Recording, Track
from tests.unit.riot_bus_logtools.comparison.recordings import BEGIN, MS, recording, said


def test_messages_by_topic():
    both = sorted(said(b"1", b"2", b"1") + said(b"x", key="b", begin=BEGIN + 1), key=lambda each: each.time)
    found = recording(both)
    assert (found.count, found.start, list(found.tracks)) == (4, BEGIN, ["a", "b"])
    track = found.tracks["a"]
    assert (len(track), list(track.places), list(track.times)) == (3, [0, 2, 3], [BEGIN, BEGIN + MS, BEGIN + 2 * MS])
    assert track.hashes[0] == track.hashes[2] != track.hashes[1]
    assert track.encodings == {"zenoh/bytes"}


def test_what_a_receiver_can_see_makes_the_hash():
    track = Track("a", "a")
    plain = Message(0, "a", b"x")
    for each in (plain, plain.with_(kind="delete"), plain.with_(attachment=b""), plain.with_(attachment=b"y")):
        track.add(each, 0)
    assert len(set(track.hashes)) == 4
    track.add(plain.with_(time=5, sequence=3, segment="s"), 0)
    assert track.hashes[-1] == track.hashes[0]


def test_what_a_middleware_attaches_is_no_content():
    key = "0/chatter/std_msgs::msg::dds_::String_/RIHS01_" + "0" * 64
    registry = TypeRegistry(load_adapters(["ros2"]))
    messages = [Message(0, key, b"x", attachment=bytes([number])) for number in range(2)]
    found = Recording("log", registry, lambda keys: iter(messages))
    (track,) = found.tracks.values()
    assert (track.topic, track.attachments, len(set(track.hashes))) == ("/chatter", False, 1)


def test_times_beyond_those_of_numpy():
    track = Track("a", "a")
    track.add(Message((1 << 64) - 1, "a", b""), 0)
    assert track.times[0] == (1 << 63) - 1


def test_messages_that_are_kept():
    messages = said(*(str(number).encode() * 1000 for number in range(10)))
    messages[5] = messages[5].with_(kind="delete", attachment=b"t")
    found = recording([*messages, *said(b"other", key="b", begin=BEGIN + 20 * MS)])
    found.keep({"a": [range(2, 4), range(5, 6)], "b": []})
    assert [found.message("a", place) for place in (5, 2, 3)] == [messages[5], messages[2], messages[3]]
    for place in (0, 4, 6, 9):
        with pytest.raises(KeyError):
            found.message("a", place)
    found.keep({"b": [range(0, 1)]})
    assert found.message("b", 0).payload == b"other"
    assert found.message("a", 3) == messages[3]
    found.close()


def test_nothing_is_read_again_if_nothing_is_wanted():
    reads = []
    known = said(b"1")

    def messages(keys):
        reads.append(keys)
        return iter(known)

    found = Recording("log", TypeRegistry(), messages)
    found.keep({"a": []})
    assert reads == [None]
