"""The player's commands, with a clock that jumps to where it is waited for, and commands at set times."""

from __future__ import annotations

import threading
from bisect import bisect_left

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.playback.pace import SteadyPace
from riot_bus.log.playback.player import Player
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from tests.manual_clock import ManualClock
from tests.tiers import scaled

SECOND = 10**9
BEGIN = 1000 * SECOND


class ListSource:
    """Messages in memory."""

    def __init__(self, messages, start=None, end=None):
        self.log = list(messages)
        self.start = start if start is not None else self.log[0].time if self.log else 0
        self.end = end if end is not None else self.log[-1].time if self.log else 0

    def messages(self, start=None):
        return iter(self.log[bisect_left(self.log, start or 0, key=lambda message: message.time) :])


class ScriptedPace(ManualClock):
    """Carries out what is due when the player waits; a player that waits for ever without anybody to wake it fails."""

    def __init__(self, script=(), start=BEGIN):
        super().__init__(start)
        self.script = sorted(((start + int(after * SECOND), number, do) for number, (after, do) in enumerate(script)))

    def wait(self, bell, until):
        if self.script and (until is None or self.script[0][0] <= until):
            at, _, do = self.script.pop(0)
            self.sleep_until(at)
            do()
        else:
            assert until is not None, "waits for ever"
            self.sleep_until(until)


def messages(*seconds):
    return [Message(int(time * SECOND), "a", b"%d" % number, sequence=number) for number, time in enumerate(seconds)]


class Play:
    """A player, and what it published when."""

    def __init__(self, log, script=(), **settings):
        self.pace = ScriptedPace(
            [(after, lambda name=name, args=args: self(name, *args)) for after, name, *args in script]
        )
        self.out, self.when = [], []
        self.player = Player(
            log if hasattr(log, "messages") else ListSource(log), self.publish, pace=self.pace, **settings
        )

    def __call__(self, name, *args):
        getattr(self.player, name)(*args)

    def publish(self, message):
        self.out.append(message.sequence)
        self.when.append((self.pace.now() - BEGIN) / SECOND)

    def run(self):
        self.player.run()
        return self


def test_plays_in_order_at_the_recorded_times():
    play = Play(messages(5, 6, 6, 6, 8.5)).run()
    assert play.out == [0, 1, 2, 3, 4]
    assert play.when == [0, 1, 1, 1, 3.5]
    assert (play.player.status().published, play.player.status().state) == (5, "ended")


@pytest.mark.parametrize("rate", [0.1, 0.5, 1.0, 2.0, 50.0])
def test_rate(rate):
    play = Play(messages(5, 6, 8), rate=rate).run()
    assert play.when == [0, pytest.approx(1 / rate), pytest.approx(3 / rate)]


def test_as_fast_as_possible_never_waits():
    play = Play(messages(5, 6, 800), rate=0).run()
    assert play.when == [0, 0, 0]
    assert play.player.lateness.count == 0


def test_time_before_the_first_message_is_played_too():
    assert Play(ListSource(messages(5, 6), start=3 * SECOND)).run().when == [2, 3]


def test_another_rate_holds_from_now_on():
    play = Play(messages(0, 10, 20), [(5, "set_rate", 2.0), (9, "set_rate", 0.5)]).run()
    # 5 s at 1x, 2.5 s at 2x -> 10 s; 1.5 s more -> 13 s at 9 s; the other 7 s take 14 s
    assert play.when == [0, 7.5, 23]


def test_as_fast_as_possible_from_now_on_and_back():
    play = Play(messages(0, 10, 20, 30), [(5, "set_rate", 0.0)], rate=1.0).run()
    assert play.when == [0, 5, 5, 5]


@pytest.mark.parametrize("rate", [-1.0, 1e-300, 1e300, float("nan"), float("inf")])
def test_rate_must_be_a_speed(rate):
    play = Play(messages(0, 1))
    for act in (lambda: Play([], rate=rate), lambda: play.player.set_rate(rate)):
        with pytest.raises(ConfigError, match="not a speed"):
            act()


def test_pause_stops_time():
    play = Play(messages(0, 10), [(4, "pause"), (5, "pause"), (7, "resume"), (8, "resume")]).run()
    assert play.when == [0, 13]


def test_begin_paused_and_step():
    script = [(1, "step"), (2, "step", 2), (3, "resume")]
    play = Play(messages(0, 10, 20, 30), script, paused=True).run()
    assert play.when == [1, 2, 2, 13]
    assert play.player.lateness.worst == 0


def test_step_while_playing_pauses():
    play = Play(messages(0, 10, 20), [(5, "step"), (6, "resume")]).run()
    assert play.when == [0, 5, 16]


def test_steps_that_were_not_made_are_forgotten_on_resume():
    play = Play(messages(0, 1, 11), [(1, "step", 0), (3, "resume")], paused=True).run()
    assert play.when == [3, 4, 14]


def test_seek_forth_and_back():
    play = Play(messages(0, 10, 20, 30), [(1, "seek", 19 * SECOND), (5, "seek", 9 * SECOND)]).run()
    assert play.out == [0, 2, 1, 2, 3]
    assert play.when == [0, 2, 6, 16, 26]


def test_seek_goes_neither_before_the_beginning_nor_after_the_end():
    play = Play(messages(5, 10), [(1, "seek", 0), (2, "seek", 10**20)]).run()
    assert play.out == [0, 0, 1]
    assert play.when == [0, 1, 2]


def test_seek_while_paused_waits():
    play = Play(messages(0, 10, 20), [(1, "pause"), (2, "seek", 15 * SECOND), (4, "resume")]).run()
    assert (play.out, play.when) == ([0, 2], [0, 9])


def test_loop_with_a_delay_before_each_pass():
    play = Play(messages(5, 6), [(8.5, "stop")], loop=True, delay=2.0).run()
    assert (play.out, play.when) == ([0, 1, 0, 1, 0], [2, 3, 5, 6, 8])
    assert play.player._stopped
    assert play.player.status().passes == 3


def test_delay_holds_as_fast_as_possible_too():
    assert Play(messages(5, 6), delay=2.0, rate=0.0).run().when == [2, 2]


def test_rate_during_the_delay_does_not_shorten_it():
    assert Play(messages(5, 7), [(1, "set_rate", 2.0)], delay=3.0).run().when == [3, 4]


@pytest.mark.parametrize("loop", [False, True])
def test_nothing_to_play_ends_at_once(loop):
    assert Play([], loop=loop).run().player.status().published == 0


def test_hold_stays_at_the_end_and_can_go_back():
    play = Play(messages(5, 6), [(3, "seek", 6 * SECOND), (9, "stop")], hold=True)
    play.pace.script.append((BEGIN + 20 * SECOND, 9, lambda: None))
    play.run()
    assert (play.out, play.when) == ([0, 1, 1], [0, 1, 3])


def test_stop_while_waiting_and_while_paused():
    assert Play(messages(0, 100), [(1, "stop")]).run().out == [0]
    assert Play(messages(0, 100), [(1, "stop")], paused=True).run().out == []


def test_slow_publication_does_not_shift_what_comes_later():
    play = Play(messages(0, 1, 2, 3))
    published = play.publish

    def slow(message):
        published(message)
        play.pace.advance(int(1.5 * SECOND) if message.sequence == 0 else 0)

    play.player._publish = slow
    play.run()
    assert play.when == [0, 1.5, 2, 3]
    assert play.player.lateness.worst == 0.5


def test_a_pause_while_behind_skips_nothing_of_the_time_line():
    play = Play(messages(0, 1, 2, 9))
    published = play.publish

    def slow(message):
        published(message)
        if message.sequence == 0:
            play.pace.advance(5 * SECOND)
            play.player.pause()
            play.pace.script.append((BEGIN + 6 * SECOND, 0, play.player.resume))

    play.player._publish = slow
    play.run()
    assert play.when == [0, 7, 8, 15]


def test_status_tells_the_position():
    play = Play(messages(5, 15))
    seen = []
    play.pace.script = [(BEGIN + 4 * SECOND, 0, lambda: seen.append(play.player.status()))]
    assert play.player.status().state == "ready"
    play.run()
    assert (seen[0].position, seen[0].state, seen[0].published) == (9 * SECOND, "playing", 1)
    end = play.player.status()
    assert (end.state, end.position, end.start, end.end) == ("ended", 15 * SECOND, 5 * SECOND, 15 * SECOND)


def test_time_stands_still_while_others_settle():
    play = Play(messages(0, 1, 2))
    positions = []

    def settle(given_up):
        assert not given_up()
        play.pace.advance(10 * SECOND)
        positions.append(play.player.status().position / SECOND)

    play.player._settle = settle
    play.run()
    assert play.when == [0, 11, 22]
    assert positions == [0, 1, 2]
    assert play.player.lateness.worst == 0


def test_an_error_of_the_publisher_ends_the_play():
    play = Play(messages(0, 1))
    play.player._publish = lambda message: 1 // 0
    with pytest.raises(ZeroDivisionError):
        play.run()
    assert play.player.status().state == "ended"


COMMANDS = st.one_of(
    st.tuples(st.sampled_from(["pause", "resume", "stop"])),
    st.tuples(st.just("step"), st.integers(0, 4)),
    st.tuples(st.just("set_rate"), st.sampled_from([0.0, 0.1, 1.0, 7.0])),
)
TIMES = st.lists(st.integers(0, 40), min_size=1, max_size=30).map(sorted)


@given(TIMES, st.lists(st.tuples(st.floats(0, 60), COMMANDS), max_size=12), st.booleans())
@settings(max_examples=scaled(300), deadline=None)
def test_whatever_is_commanded_messages_come_in_order_and_once(times, commands, paused):
    script = [(after, *command) for after, command in commands] + [(200, "resume"), (201, "set_rate", 0.0)]
    play = Play(messages(*times), script, paused=paused).run()
    assert play.out == list(range(len(play.out)))
    assert play.player._stopped or len(play.out) == len(times)
    assert play.when == sorted(play.when)


SEEKS = st.one_of(COMMANDS, st.tuples(st.just("seek"), st.integers(0, 40).map(lambda time: time * SECOND)))


@given(TIMES, st.lists(st.tuples(st.floats(0, 60), SEEKS), max_size=12), st.booleans())
@settings(max_examples=scaled(300), deadline=None)
def test_only_seeking_and_looping_break_the_order(times, commands, loop):
    script = [(after, *command) for after, command in commands] + [(200, "resume"), (500, "stop"), (501, "stop")]
    play = Play(messages(*times), script, loop=loop, delay=1.0 if loop else 0.0).run()
    jumps = sum(former + 1 != after for former, after in zip(play.out, play.out[1:], strict=False))
    seeks = sum(command[0] == "seek" for _, command in commands)
    assert jumps <= seeks + play.player.status().passes - 1
    if not seeks and play.out:
        assert play.out[0] == 0


def test_commands_from_another_thread_wake_a_player_that_waits():
    out = []
    player = Player(ListSource(messages(0, 3600)), out.append, pace=SteadyPace())
    thread = threading.Thread(target=player.run)
    thread.start()
    player.seek(3600 * SECOND)
    thread.join(20)
    assert not thread.is_alive()
    assert out[-1].sequence == 1


def test_stop_wakes_a_paused_player():
    player = Player(ListSource(messages(0, 3600)), lambda message: None, pace=SteadyPace(), paused=True)
    thread = threading.Thread(target=player.run)
    thread.start()
    player.stop()
    thread.join(20)
    assert not thread.is_alive()


def test_steady_pace_is_never_early():
    pace, bell = SteadyPace(), threading.Condition()
    for after in (0, 20_000, 300_000, 3_000_000):
        until = pace.now() + after
        with bell:
            while pace.now() < until:
                pace.wait(bell, until)
        assert pace.now() >= until


def test_steps_that_were_not_made_are_forgotten_on_seek():
    play = Play(messages(0, 10, 20), [(1, "step", 5), (2, "seek", 0), (3, "resume")], hold=True, paused=True)
    play.pace.script.append((BEGIN + 100 * SECOND, 9, play.player.stop))
    play.run()
    assert (play.out, play.when) == ([0, 1, 2, 0, 1, 2], [1, 1, 1, 3, 13, 23])


class SlowSource(ListSource):
    """Reads a message only when it may."""

    def __init__(self, messages):
        super().__init__(messages)
        self.reading, self.go_on = threading.Event(), threading.Event()

    def messages(self, start=None):
        for message in super().messages(start):
            self.reading.set()
            assert self.go_on.wait(20)
            yield message


def test_commands_do_not_wait_for_a_slow_disk():
    source, out = SlowSource(messages(0, 0, 0)), []
    player = Player(source, out.append, pace=SteadyPace())
    thread = threading.Thread(target=player.run)
    thread.start()
    assert source.reading.wait(20)
    player.pause()
    player.set_rate(2.0)
    assert (player.status().state, player.status().rate) == ("paused", 2.0)
    player.stop()
    source.go_on.set()
    thread.join(20)
    assert not thread.is_alive()
    assert out == []


def test_what_was_being_read_when_somebody_sought_is_not_played():
    source, out = SlowSource(messages(0, 1, 1000)), []
    player = Player(source, lambda message: out.append(message.sequence), pace=SteadyPace())
    thread = threading.Thread(target=player.run)
    thread.start()
    assert source.reading.wait(20)
    player.seek(1000 * SECOND)
    source.go_on.set()
    thread.join(20)
    assert not thread.is_alive()
    assert out == [2]


@pytest.mark.parametrize("rate", [1e-6, 1e6])
def test_times_beyond_all_measure_do_no_harm(rate):
    source = ListSource([Message(0, "a", b""), Message((1 << 64) - 1, "a", b"")])
    seen = []
    play = Play(source, [(1, "pause"), (2, "resume"), (3, "stop")], rate=rate)
    play.pace.script.insert(1, (BEGIN + SECOND, 0, lambda: seen.append(play.player.status().position)))
    play.run()
    assert seen == [pytest.approx(rate * SECOND)]


def test_opening_a_log_makes_nothing_late():
    log = ListSource(messages(0, 1, 2, 10, 11))
    play = Play(log, [(9, "seek", 10 * SECOND)], loop=False)
    read = log.messages

    def slow(start=None):
        play.pace.advance(3 * SECOND)
        yield from read(start)

    log.messages = slow
    play.run()
    assert play.when == [3, 4, 5, 12, 13]
    assert play.player.lateness.worst == 0
