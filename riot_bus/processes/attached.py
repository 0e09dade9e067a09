"""Stand-in for a component that runs already: finds the processes connected to a port, and ends when one of them ends.

Usage: `python -m riot_bus.processes.attached PORT PID`, with the id of riot's process, which is left out. It prints the
ids of the processes as a list, once there are any.
"""

from __future__ import annotations

import json
import os
import select
import sys
import time
from collections.abc import Sequence
from typing import Any


def attached_command(port: int) -> list[str]:
    """Return the command of the stand-in for the processes that connect to a port of this process."""
    return [sys.executable, "-E", "-P", "-m", __name__, str(port), str(os.getpid())]


def connected(port: int, *, to: int) -> list[int]:
    """Return the processes on this machine that are connected to a TCP port of `to`, as far as this user may know."""
    import psutil

    found = [
        (each.pid, _address(each.laddr), _address(each.raddr))
        for each in psutil.net_connections("tcp")
        if each.status == psutil.CONN_ESTABLISHED
    ]
    clients = {remote for pid, local, remote in found if pid == to and local[1] == port}
    pids = {pid for pid, local, _ in found if local in clients}
    return sorted(pid for pid in pids if pid is not None and pid != to)


def _address(address: Any) -> tuple[str, int]:
    return address.ip.removeprefix("::ffff:"), address.port


def wait_for_end(pids: Sequence[int]) -> int:
    """Wait until one of some processes has ended, and return its id."""
    watched = {}
    for pid in pids:
        try:
            watched[os.pidfd_open(pid)] = pid
        except ProcessLookupError:
            return pid
    ended, _, _ = select.select(list(watched), [], [])
    return watched[ended[0]]


def main(arguments: Sequence[str]) -> None:
    """Wait for processes, and for the end of one of them."""
    port, riot = map(int, arguments)
    while not (pids := connected(port, to=riot)):
        time.sleep(0.05)  # a look reads the open files of all processes: about 15 ms with 80 of them
    sys.stdout.write(f"{json.dumps(pids)}\n")
    sys.stdout.flush()
    sys.stdout.write(f"process {wait_for_end(pids)} has ended\n")


if __name__ == "__main__":
    main(sys.argv[1:])
