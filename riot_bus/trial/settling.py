"""Detection that a component has processed its input: measured, without fixed sleeps.

A component is done when the sum of voluntary context switches of all its threads stays the same, and no thread is
running or waiting for a processor (measured: a window of 15 ms came right after the last of 200 one-millisecond
callbacks in 5 of 5 tries; the state of the threads makes this reliable on a loaded machine, too). A component with its
own timers never stands still: it is done when it does no more than without input, in switches and in processor time.

Deadlines do not run while a component waits for a processor that others use: a loaded machine is not a hang.

Often it is certain, without such a window, that a process does nothing more without input (`is_at_rest`), by what each
thread waits for according to the kernel. A thread that waits for a time (a sleep, a wait with a timeout) or for a file
may go on at any moment. A thread that waits for another thread without a timeout is done when all are. So if each
thread except Zenoh's own waits in that way, or has not run since the input began, nothing can happen within the window.
Zenoh's threads wait for their sockets, with timers.
"""

from __future__ import annotations

import math
import os
import platform
import threading
import time
from collections.abc import Callable
from typing import Required, TypedDict

from riot_bus.processes.activity import STILL, Activity, Idle, Threads
from riot_bus.vocabulary.errors import EnvironmentFaultError

POLL = 0.004
"""Seconds between looks at what takes some time."""
_SENT_POLL = 0.0002
_REST_POLL, _REST_S = 0.001, 0.05
"""As long as a unit usually takes for a log, it is asked often whether it rests: its outputs tell at little cost."""
_SENDERS = (b"app-", b"tx-", b"net-")
_LONGER, _LONGER_BY = 10, 60.0  # after waiting nine tenths of it for a processor: no verdict; a minute for short ones
_MORE_SWITCHES, _MORE_TIME, _SLACK = 2.0, 3.0, 0.05
"""Timers vary: only more than twice the switches, or thrice the time and 5 % of a processor, is work; guesses."""
RUNTIME = (b"app-", b"tx-", b"rx-", b"net-", b"acc-")
"""Prefixes of the names of the threads of Zenoh's runtimes."""
_FUTEX, _EPOLL = {"x86_64": (202, (232, 281)), "aarch64": (98, (22,))}.get(platform.machine(), (-1, ()))
"""Numbers of system calls; elsewhere nothing is certain."""


class _Own(threading.local):
    """Threads of this process, for each thread that reads them: files stay open, and there are a hundred threads.

    Attributes:
        senders: Zenoh's threads that send. A transmission that was not yet carried out leaves its thread runnable.
        others: All threads but the one that asks.
    """

    def __init__(self) -> None:
        self.senders = Threads([os.getpid()], names=_SENDERS)
        self.others = Threads([os.getpid()], but=threading.get_native_id())


OWN = _Own()


class RestOptions(TypedDict, total=False):
    """Options of `wait_settled` that layers above pass on to it."""

    window: Required[float]
    idle: Idle
    since: Activity | None
    hangs: Callable[[], bool]
    rests: Callable[[], bool] | None


def wait_sent(senders: Threads, *, timeout: float) -> bool:
    """Wait until none of Zenoh's threads that send wants the processor: what was put is on its way."""
    deadline, new = time.monotonic() + timeout, True
    while time.monotonic() < deadline:
        if not senders.busy(new=new):
            return True
        new = False
        time.sleep(_SENT_POLL)
    return False


def _never() -> bool:
    return False


def wait_taken(
    threads: Threads, senders: Threads, *, before: int, timeout: float, hopeless: Callable[[], bool] = _never
) -> bool:
    """Wait until processes have received all input: it is sent, they have run since, and all their threads sleep."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline and not hopeless():
        ran = threads.ran()
        if ran > before and not senders.busy(new=False) and threads.rests(ran):
            return True
        time.sleep(_SENT_POLL)
    return False


def wait_settled(
    threads: Threads,
    *,
    window: float,
    timeout: float,
    idle: Idle = STILL,
    since: Activity | None = None,
    alive: Callable[[], bool] = lambda: True,
    hangs: Callable[[], bool] = _never,
    rests: Callable[[], bool] | None = None,
) -> bool:
    """Wait until the processes have stood still for `window` seconds, or one of them has died.

    Args:
        timeout: Deadline in seconds, without the time that the processes waited for a processor.
        since: Activity before the last input; the processes count as not having received that input until they have run
            since, or ten windows have passed.
        hangs: Function that returns True when the processes are known to be busy for ever.
        rests: Function that returns True when nothing more can happen without input, so that there is no need to wait
            for the window; None if that is unknown.

    Returns:
        False when the deadline passed while they were still busy, or they hang.

    Raises:
        EnvironmentFaultError: Others used the processors most of the time, so no statement is possible.
    """
    begun = threads.activity()
    start = time.monotonic()
    pause = min(max(window / 8, POLL), 5 * POLL)  # some looks in a window, without taking the unit's time
    calm = _Calm(begun, idle, start)
    received, looked = since is None, -math.inf
    while True:
        # In this order, for others may have the processor in between: who sleeps here, and has not run by the look that
        # follows, has slept since `calm.since`, which is taken after a look. Else a pause passes for rest.
        now = time.monotonic()
        often = rests is not None and now - start < _REST_S
        if rests is not None and often and now - looked < pause and not rests() and alive():
            time.sleep(_REST_POLL)
            continue
        looked = now
        busy = now - calm.since >= window and threads.busy()
        seen = threads.activity()
        if not alive():
            return True
        if hangs():
            return False
        calm.see(seen, now)
        if since is not None and seen.switches > since.switches:
            received = True
        if not received and now - start > 10 * window:
            received = True
        if received and now - calm.since >= window and not busy and calm.confirmed(seen, now):
            return True
        if received and rests is not None and rests():
            return True
        if now - start > timeout:
            if now - start - seen.waited_since(begun) > timeout:
                return False
            if now - start > _LONGER * timeout + _LONGER_BY:
                raise EnvironmentFaultError(
                    f"components got so little of the processors that they were not done within {now - start:.0f} s",
                    hint="run fewer trials at once (--jobs), or stop what else runs on this machine",
                )
        time.sleep(_REST_POLL if often else pause)


class _Calm:
    """Since when processes have done no more than without input."""

    def __init__(self, begun: Activity, idle: Idle, now: float) -> None:
        self.since = now
        self._idle, self._begun = idle, begun

    def see(self, seen: Activity, now: float) -> None:
        """Begin anew if there were more switches than without input."""
        allowed = _MORE_SWITCHES * self._idle.switches * (now - self.since) + (1 if self._idle.switches else 0)
        ran = not self._idle.switches and seen.ran_since(self._begun) > 0  # long, without giving up the processor
        if ran or not 0 <= seen.switches - self._begun.switches <= allowed:
            self._begin(seen)

    def confirmed(self, seen: Activity, now: float) -> bool:
        """Return whether they have not run for longer than without input either; if they have, begin anew."""
        if not self._idle.switches:
            return True
        allowed = _MORE_TIME * self._idle.ran + _SLACK
        if seen.ran_since(self._begun) <= allowed * seen.had_since(self._begun, seconds=now - self.since):
            return True
        self._begin(seen)
        return False

    def _begin(self, seen: Activity) -> None:
        self._begun, self.since = seen, time.monotonic()


def waits_for_input(name: bytes, call: bytes, *, window: float) -> bool:
    """Return whether a thread waits for another thread of its process, or is one of Zenoh's and waits for its sockets.

    Args:
        call: Line of the thread in /proc: number of the system call and its arguments.
        window: Seconds within which no timer of Zenoh's may be due.
    """
    words = call.split()
    if len(words) < 5 or not words[0].isdigit():  # it runs
        return False
    number, arguments = int(words[0]), [int(word, 16) for word in words[1:5]]
    if number == _FUTEX:
        how, timeout = arguments[1], arguments[3]
        return how & 0xFF in (0x80, 0x89) and not timeout  # FUTEX_WAIT, FUTEX_WAIT_BITSET; FUTEX_PRIVATE_FLAG
    if number in _EPOLL and name.startswith(RUNTIME):
        milliseconds = arguments[3] & 0xFFFFFFFF
        return milliseconds >= 1 << 31 or milliseconds >= window * 1e3
    return False


def all_wait(threads: Threads, *, since: Activity, window: float) -> bool:
    """Return whether each thread was seen to wait for input, one after the other in the order of their begin.

    So it is certain of threads that only get work from those that have begun before them.

    Args:
        since: Activity before the input; a thread that has not run since is not affected by it.
    """
    return all(
        waits_for_input(name, call, window=window)
        or (call[:1].isdigit() and threads.switches_of(thread) == since.of(thread)[2])
        for thread, name, call in threads.calls()
    )


def is_at_rest(threads: Threads, *, since: Activity, window: float) -> bool:
    """Return whether all threads of processes wait for input at the same time; False where that is not certain.

    Arguments are those of `all_wait`.
    """
    before = threads.ran()
    return bool(before) and all_wait(threads, since=since, window=window) and threads.rests(before)
