"""Certainty that a process does nothing more without input, by what each thread waits for according to the kernel.

A thread that waits for a time (a sleep, a wait with a timeout) or for a file may go on at any moment; then only a
window without activity shows that it is done (`settling`). A thread that waits for another thread without a timeout is
done when all are. So if each thread except Zenoh's own waits in that way, or has not run since the input began, nothing
can happen within that window, and there is no need to wait for it. Zenoh's threads wait for their sockets, with timers.
"""

from __future__ import annotations

import platform
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.sut.activity import Activity, Threads

__all__ = ["RUNTIME", "all_wait", "is_at_rest", "waits_for_input"]

RUNTIME = (b"app-", b"tx-", b"rx-", b"net-", b"acc-")
"""What names of the threads of Zenoh's runtimes begin with."""
_FUTEX, _EPOLL = {"x86_64": (202, (232, 281)), "aarch64": (98, (22,))}.get(platform.machine(), (-1, ()))
"""Numbers of system calls; elsewhere nothing is certain."""
_PRIVATE, _COMMAND, _WAITS = 0x80, 0x7F, (0, 9)
"""Of a futex: the flag of one that no other process wakes, what to do, and the two ways to wait."""


def waits_for_input(name: bytes, call: bytes, *, window: float) -> bool:
    """Return whether a thread waits for another thread of its process, or is one of Zenoh's and waits for its sockets.

    Args:
        name: Its name.
        call: Its line in /proc: number of the system call and its arguments.
        window: Seconds within which no timer of Zenoh's may be due.
    """
    words = call.split()
    if len(words) < 5 or not words[0].isdigit():  # it runs
        return False
    number, arguments = int(words[0]), [int(word, 16) for word in words[1:5]]
    if number == _FUTEX:
        how, timeout = arguments[1], arguments[3]
        return bool(how & _PRIVATE) and how & _COMMAND in _WAITS and not timeout
    if number in _EPOLL and name.startswith(RUNTIME):
        milliseconds = arguments[3] & 0xFFFFFFFF
        return milliseconds >= 1 << 31 or milliseconds >= window * 1e3
    return False


def all_wait(threads: Threads, *, since: Activity, window: float) -> bool:
    """Return whether each thread was seen to wait for input, one after the other in the order of their begin.

    So it is certain of threads that only get work from those that have begun before them.

    Args:
        threads: Those of some processes.
        since: What they had done before the input; a thread that has not run since has nothing to do with it.
        window: Seconds within which no timer of Zenoh's may be due.
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
