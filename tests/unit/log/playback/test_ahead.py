import threading

import pytest

from riot_bus.log.playback.ahead import AheadSource
from riot_bus.vocabulary.message import Message

MIB = 1 << 20


class Counting:
    """A source that says how far it was read."""

    def __init__(self, count, size=1):
        self.count, self.size = count, size
        self.start, self.end = 0, count - 1
        self.read = 0
        self.bell = threading.Condition()

    def messages(self, start=None):
        for number in range(start or 0, self.count):
            with self.bell:
                self.read = number + 1
                self.bell.notify_all()
            yield Message(number, "a", bytes(self.size))

    def stands_still_at_most(self, most):
        """Wait until reading has stopped for want of room."""
        with self.bell:
            while self.bell.wait(0.2):
                assert self.read <= most
            return self.read


def test_messages_are_those_of_the_source():
    source = AheadSource(Counting(10_000))
    assert [message.time for message in source.messages()] == list(range(10_000))
    assert [message.time for message in source.messages(9_998)] == [9_998, 9_999]
    assert (source.start, source.end) == (0, 9_999)


@pytest.mark.parametrize(("size", "most"), [(1, 3000), (10_000, 3500), (3 * MIB, 20), (100 * MIB, 4)])
def test_memory_is_bounded_by_messages_and_by_bytes(size, most):
    counting = Counting(100_000, size)
    source = AheadSource(counting)
    found = source.messages()
    next(found)
    assert counting.stands_still_at_most(most) >= 2
    found.close()
    source.close()


def test_closing_ends_the_thread_whatever_it_waits_for():
    source = AheadSource(Counting(100_000))
    found = source.messages()
    next(found)
    (ahead,) = source._open
    source.close()
    assert not ahead.thread.is_alive()
    assert list(found) == [Message(number, "a", b"\0") for number in range(1, 64)]  # the batch at hand


def test_what_the_source_raises_comes_after_the_messages_before():
    class Broken(Counting):
        def messages(self, start=None):
            yield from super().messages(start)
            raise OSError("the disk has gone")

    found = AheadSource(Broken(100)).messages()
    assert [next(found).time for _ in range(100)] == list(range(100))
    with pytest.raises(OSError, match="gone"):
        next(found)
