import threading

import pytest

from riot_bus.play.simclock import Ticker
from riot_bus.types.capabilities import Offer, SimClock

SECOND = 10**9
CLOCK = SimClock("/clock", Offer("0/clock"), lambda time: b"%d" % time)


class Told:
    """What was published, and where the player is."""

    def __init__(self):
        self.times = []
        self.position = 100 * SECOND
        self.bell = threading.Condition()

    def publish(self, message):
        assert (message.key, message.payload) == ("0/clock", b"%d" % message.time)
        with self.bell:
            self.times.append(message.time)
            self.bell.notify_all()

    def ticker(self, hertz):
        return Ticker(CLOCK, self.publish, lambda: self.position, hertz)


@pytest.fixture
def told():
    return Told()


def test_time_is_told_before_the_messages_of_that_time(told):
    ticker = told.ticker(10.0)
    for tenths in (1000, 1000.5, 1000.9, 1001, 1001.5, 1050):
        ticker.before(int(tenths * SECOND / 10))
    assert told.times == [100 * SECOND, 1001 * SECOND // 10, 105 * SECOND]


def test_time_that_goes_back_is_told_at_once(told):
    ticker = told.ticker(10.0)
    for time in (105 * SECOND, 100 * SECOND, 100 * SECOND):
        ticker.before(time)
    assert told.times == [105 * SECOND, 100 * SECOND]


def test_it_ticks_while_nothing_is_played(told):
    ticker = told.ticker(1000.0)
    ticker.start()
    with told.bell:
        assert told.bell.wait_for(lambda: len(told.times) >= 5, 30)
        told.position = 200 * SECOND
        assert told.bell.wait_for(lambda: told.times[-1] == 200 * SECOND, 30)
    ticker.close()
    assert set(told.times) == {100 * SECOND, 200 * SECOND}
    assert told.times == sorted(told.times)


def test_it_can_be_closed_before_it_starts(told):
    told.ticker(10.0).close()
    assert told.times == []
