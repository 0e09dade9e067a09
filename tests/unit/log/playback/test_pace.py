import threading
import time

from riot_bus.log.playback.pace import SteadyPace


def test_it_is_the_machines_time():
    assert abs(SteadyPace().now() - time.time_ns()) < 10**9


def test_it_never_goes_back():
    pace = SteadyPace()
    times = [pace.now() for _ in range(10_000)]
    assert times == sorted(times)


def test_waiting_ends_when_somebody_rings():
    pace, bell = SteadyPace(), threading.Condition()

    def ring():
        with bell:
            bell.notify_all()

    for until in (None, pace.now() + 3600 * 10**9, 1 << 80):  # the last one is further off than a thread can wait
        with bell:
            threading.Thread(target=ring).start()
            pace.wait(bell, until)


def test_waiting_for_what_has_been_ends_at_once():
    pace, bell = SteadyPace(), threading.Condition()
    with bell:
        pace.wait(bell, pace.now() - 10**9)
