import pytest

from riot_bus.log.playback.player import play
from riot_bus.vocabulary.clock import ManualClock
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

SECOND = 10**9
LOG = [Message(SECOND * time, "a", b"%d" % time) for time in (5, 6, 6, 8, 7, 9)]


def test_as_fast_as_possible_keeps_the_order_and_does_not_wait():
    clock, out = ManualClock(100), []
    report = play(LOG, out.append, clock=clock)
    assert out == LOG
    assert (report.count, report.seconds, report.latest, report.stopped) == (6, 0.0, 0.0, False)


def test_paced_by_absolute_deadlines():
    clock, when = ManualClock(100 * SECOND), []

    def publish(message):
        when.append(clock.now() / SECOND)
        clock.advance(SECOND // 4)  # slow publication must not shift the later ones

    report = play(LOG, publish, rate=2.0, clock=clock)
    assert when == [100.0, 100.5, 100.75, 101.5, 101.75, 102.0]
    assert report.latest == 0.75  # the message of 7 s comes after that of 8 s


def test_stop_is_asked_before_messages_and_while_waiting():
    clock, out = ManualClock(), []
    report = play(LOG, out.append, clock=clock, stop=lambda: len(out) == 2)
    assert (report.count, report.stopped) == (2, True)
    out.clear()
    report = play(LOG, out.append, rate=1.0, clock=clock, stop=lambda: clock.now() > SECOND // 2)
    assert report.count == 1
    assert clock.now() < SECOND


@pytest.mark.parametrize("rate", [-1.0, float("nan"), float("inf")])
def test_rate_must_be_a_speed(rate):
    with pytest.raises(ConfigError, match="not a speed"):
        play(LOG, print, rate=rate, clock=ManualClock())
