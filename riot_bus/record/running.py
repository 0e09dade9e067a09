"""`riot record`: records until it is told to stop, then says what happened."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

from riot_bus.control.heap import roomy_heap
from riot_bus.control.signals import ended_by_signals
from riot_bus.record.service import CaptureService
from riot_bus.record.text import progress_line, result_lines
from riot_bus.vocabulary.errors import INTERRUPTED, DataLossError
from riot_bus.vocabulary.redaction import escape_control_chars, redacted

if TYPE_CHECKING:
    from riot_bus.control.terminal import Foreground
    from riot_bus.record.options import CaptureOptions

_WRITE_S = 300.0
"""Longest time to write what waits in memory: 256 MiB (--queue-size) at 1 MB/s, a slow SD card."""


def run_capture(options: CaptureOptions, foreground: Foreground) -> None:
    """Record until SIGINT, SIGTERM, the end of its duration or a command, then report the result.

    SIGUSR1 writes the ring, or begins another file. A second SIGINT or SIGTERM ends the process at once.

    Raises:
        ConfigError: An option is wrong, or the file cannot be written.
        EnvironmentFaultError: No router answers at the endpoint.
        DataLossError: Messages are lost.
    """

    def warn(line: str) -> None:
        foreground.warn(escape_control_chars(line) if "\n" not in line else line)

    roomy_heap()
    service = CaptureService(options, warn=warn)
    actions = {
        " ": lambda: (service.resume if service.paused else service.pause)(),
        "s": service.cut,
        "d": service.cut,
        "q": service.stop,
    }
    with ended_by_signals(service.stop, again=_leave, others={signal.SIGUSR1: service.cut}, deadline=_WRITE_S):
        try:
            with service:
                started = {"recorder": service.name, "status": service.status()}
                foreground.report("started", started, [_ready(service)])
                foreground.attend(
                    service.wait,
                    keys=f"space: pause, {'d: write the ring' if options.ring_seconds else 's: another file'}, q: end",
                    actions=actions,
                    line=lambda: progress_line(service.status()),
                )
        finally:
            service.close()
    result = service.result()
    foreground.report("ended", result.document(), result_lines(result))
    if not result:
        account = result.account
        reasons = ", ".join(f"{reason}: {account.total(reason)}" for reason in account.lost if account.total(reason))
        parts = [f"{account.total()} messages are lost ({reasons})"] if account else []
        raise DataLossError("; ".join([*parts, *result.problems]))


def _ready(service: CaptureService) -> str:
    options = service.options
    ring = f"the last {options.ring_seconds:g} s" if options.ring_seconds else service.status()["file"]
    state = ", paused" if service.paused else ""
    where = redacted(options.endpoint)
    return escape_control_chars(f"{service.name}: {', '.join(options.keys)} of {where} to {ring}{state}")


def _leave() -> None:
    """End the process, but not by an exception, which would wait for a disk or link that hangs."""
    sys.stderr.write("riot: ended at once; the file is readable up to its last chunk\n")
    sys.stderr.flush()
    os._exit(INTERRUPTED)
