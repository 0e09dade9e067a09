from hypothesis import given
from hypothesis import strategies as st

from riot_bus.log.playback.recall import RecallingSource
from riot_bus.vocabulary.message import Message


class Log:
    """Messages in memory; notes what was read to find what is latched."""

    def __init__(self, *messages):
        self.log = [Message(time, key, b"%d" % number) for number, (time, key) in enumerate(messages)]
        self.start, self.end = self.log[0].time, self.log[-1].time
        self.read = []

    def messages(self, start=None):
        return iter([message for message in self.log if message.time >= (start or 0)])

    def before(self, since, until):
        self.read.append((since, until))
        return iter([message for message in self.log if since <= message.time < until and message.key != "c"])


def recalling(log, **depths):
    return RecallingSource(log, log.before, depths, origin=log.start)


def shown(messages):
    return [(message.key, message.payload, message.time) for message in messages]


LOG = [(0, "a"), (1, "b"), (2, "a"), (3, "a"), (4, "c"), (5, "a"), (6, "c")]


def test_at_the_beginning_nothing_is_recalled():
    log = Log(*LOG)
    assert shown(recalling(log, a=2, b=1).messages()) == shown(log.log)
    assert log.read == []


def test_the_last_messages_of_each_topic_come_first_in_their_order():
    source = recalling(Log(*LOG), a=2, b=1)
    found = shown(source.messages(5))
    assert found == [("b", b"1", 5), ("a", b"2", 5), ("a", b"3", 5), ("a", b"5", 5), ("c", b"6", 6)]


def test_what_was_read_is_not_read_again():
    log = Log(*LOG)
    source = recalling(log, a=1, b=1)
    for start in (2, 4, 4, 3, 6):
        list(source.messages(start))
    assert log.read == [(0, 2), (2, 4), (4, 4), (0, 3), (3, 6)]


@given(
    st.lists(st.tuples(st.integers(0, 20), st.sampled_from("ab")), min_size=1, max_size=30).map(sorted),
    st.lists(st.integers(0, 22), max_size=6),
    st.integers(1, 3),
)
def test_it_is_as_if_one_had_joined_late(log, starts, depth):
    log = Log(*log)
    source = recalling(log, a=depth, b=1)
    for start in starts:
        before = [message for message in log.log if message.time < start]
        expected = [
            message.payload
            for message in before
            if message in [each for each in before if each.key == message.key][-(depth if message.key == "a" else 1) :]
        ]
        payloads = [message.payload for message in source.messages(start)]
        assert payloads == expected + [message.payload for message in log.log if message.time >= start]
