from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Emission
from riot_bus.vocabulary.message import Message


def emission(due, name):
    return Emission(due, Message(0, name, b""), None)


def test_equal_due_times_keep_their_order():
    queue = EmissionQueue()
    queue.push(emission(5, "a"), emission(3, "b"))
    queue.push(emission(5, "c"), emission(3, "d"))
    assert queue.next_due() == 3
    assert [each.message.key for each in queue.pop_due(3)] == ["b", "d"]
    assert queue.pop_due(4) == []
    assert len(queue) == 2
    assert [each.message.key for each in queue.pop_due()] == ["a", "c"]
    assert queue.next_due() is None
