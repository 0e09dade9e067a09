import pytest

from riot_bus.log.playback.player import play
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from tests.manual_clock import ManualClock

SECOND = 10**9
LOG = [Message(SECOND * time, "a", b"%d" % time) for time in (5, 6, 6, 8, 7, 9)]


def test_as_fast_as_possible_keeps_the_order_and_does_not_wait():
    clock, out = ManualClock(100), []
    play(LOG, out.append, clock=clock)
    assert (out, clock.now()) == (LOG, 100)


def test_paced_by_absolute_deadlines():
    clock, when = ManualClock(100 * SECOND), []

    def publish(message):
        when.append(clock.now() / SECOND)
        clock.advance(SECOND // 4)  # slow publication must not shift the later ones

    play(LOG, publish, rate=2.0, clock=clock)
    assert when == [100.0, 100.5, 100.75, 101.5, 101.75, 102.0]


def test_stop_is_asked_before_messages_and_while_waiting():
    clock, out = ManualClock(), []
    play(LOG, out.append, clock=clock, stop=lambda: len(out) == 2)
    assert len(out) == 2
    out.clear()
    play(LOG, out.append, rate=1.0, clock=clock, stop=lambda: clock.now() > SECOND // 2)
    assert len(out) == 1
    assert clock.now() < SECOND


@pytest.mark.parametrize("rate", [-1.0, float("nan"), float("inf")])
def test_rate_must_be_a_speed(rate):
    with pytest.raises(ConfigError, match="not a speed"):
        play(LOG, print, rate=rate, clock=ManualClock())
