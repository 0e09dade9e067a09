import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.rclpy_node.echoes import Echoes

SECOND = 10**9


class Clock:
    def __init__(self):
        self.now = 1_000 * SECOND

    def __call__(self):
        self.now += 50_000
        return self.now


@pytest.fixture
def clock():
    return Clock()


def publish(echoes, clock, payload):
    """Return when the middleware says that it was published."""
    times = []
    echoes.publish(payload, lambda data: times.append(clock()))
    return times[0]


def test_what_was_published_here_is_an_echo_once(clock):
    echoes = Echoes(10, clock=clock)
    published = publish(echoes, clock, b"a")
    assert not echoes.is_echo(b"b", published)
    assert echoes.is_echo(b"a", published)
    assert not echoes.is_echo(b"a", published)


def test_the_same_bytes_of_somebody_else_are_none(clock):
    echoes = Echoes(10, clock=clock)
    before = clock()
    published = publish(echoes, clock, b"a")
    after = clock()
    assert not echoes.is_echo(b"a", before)
    assert not echoes.is_echo(b"a", after)
    assert echoes.is_echo(b"a", published)


def test_an_echo_may_come_before_publishing_has_returned(clock):
    echoes = Echoes(10, clock=clock)
    found = []
    echoes.publish(b"a", lambda data: found.append(echoes.is_echo(data, clock())))
    assert found == [True]
    assert not echoes.is_echo(b"a", clock())


def test_times_are_rounded(clock):
    echoes = Echoes(10, clock=clock)
    begin = clock.now + 50_000
    publish(echoes, clock, b"a")
    assert echoes.is_echo(b"a", begin - 1)


def test_a_middleware_without_times_goes_by_the_bytes(clock):
    echoes = Echoes(10, clock=clock)
    publish(echoes, clock, b"a")
    assert echoes.is_echo(b"a", 0)
    assert not echoes.is_echo(b"a", 0)


def test_what_was_not_sent_is_forgotten(clock):
    echoes = Echoes(10, clock=clock)

    def fail(data):
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        echoes.publish(b"a", fail)
    assert not echoes.is_echo(b"a", 0)


def test_the_oldest_are_forgotten(clock):
    echoes = Echoes(3, clock=clock)
    times = [publish(echoes, clock, bytes([number])) for number in range(5)]
    assert [echoes.is_echo(bytes([number]), time) for number, time in enumerate(times)] == [False] * 2 + [True] * 3


@given(st.lists(st.tuples(st.booleans(), st.sampled_from([b"a", b"b"])), max_size=40), st.randoms())
def test_of_all_that_comes_back_in_any_order_the_own_is_told_from_the_rest(sent, random):
    clock = Clock()
    echoes = Echoes(100, clock=clock)
    arriving = [(own, data, publish(echoes, clock, data) if own else clock()) for own, data in sent]
    random.shuffle(arriving)
    for own, data, published in arriving:
        assert echoes.is_echo(data, published) == own
