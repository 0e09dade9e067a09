"""`riot record`: records until it is told to stop, then says what happened."""

from __future__ import annotations

import json
import os
import signal
import sys
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.control.heap import roomy_heap
from riot_bus.control.signals import ended_by_signals
from riot_bus.control.terminal import Foreground
from riot_bus.record.keys import keys_help, press
from riot_bus.record.service import CaptureService
from riot_bus.record.text import progress_line, result_lines
from riot_bus.vocabulary.errors import DataLossError
from riot_bus.vocabulary.redaction import escape_control_chars, redacted

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from riot_bus.control.terminal import Console
    from riot_bus.record.options import CaptureOptions
    from riot_bus.record.service import CaptureResult

__all__ = ["run_capture"]

_INTERRUPTED = 130
_WRITE_S = 300.0
"""Longest time to write what waits in memory: 256 MiB (--queue-size) at 1 MB/s, a slow SD card."""


def run_capture(
    options: CaptureOptions,
    *,
    say: Callable[[str], None],
    warn: Callable[[str], None],
    console: AbstractContextManager[Console] | None = None,
    as_json: bool = False,
) -> None:
    """Record until SIGINT, SIGTERM, the end of its duration or a command, then report the result.

    SIGUSR1 writes the ring, or begins another file. A second SIGINT or SIGTERM ends the process at once.

    Args:
        options: What to record.
        say: Function that prints a line of the result.
        warn: Function that prints a line of diagnostics.
        console: Terminal that shows progress and takes keys while recording; None if there is no terminal.
        as_json: Whether to print lines of JSON.

    Raises:
        ConfigError: An option is wrong, or the file cannot be written.
        EnvironmentFaultError: Nobody answers at the endpoint.
        DataLossError: Messages are lost.
    """
    foreground = Foreground(console, warn)

    def tell(line: str) -> None:
        foreground.tell(escape_control_chars(line) if "\n" not in line else line)

    roomy_heap()
    service = CaptureService(options, warn=tell)
    with ended_by_signals(service.stop, again=_leave, others={signal.SIGUSR1: service.cut}, deadline=_WRITE_S):
        try:
            with service:
                say(_ready(service, as_json=as_json))
                foreground.attend(
                    service.wait,
                    keys=keys_help(ring=options.ring_seconds > 0),
                    press=partial(press, service),
                    line=lambda: progress_line(service.status()),
                )
        finally:
            service.close()
    _end(service.result(), say, as_json=as_json)


def _ready(service: CaptureService, *, as_json: bool) -> str:
    status = service.status()
    if as_json:
        return json.dumps({"event": "started", "recorder": service.name, "status": status}, sort_keys=True)
    keys = ", ".join(service.options.keys)
    ring = f"the last {service.options.ring_seconds:g} s" if service.options.ring_seconds else status["file"]
    state = ", paused" if service.paused else ""
    return escape_control_chars(f"{service.name}: {keys} of {redacted(service.options.endpoint)} to {ring}{state}")


def _end(result: CaptureResult, say: Callable[[str], None], *, as_json: bool) -> None:
    if as_json:
        say(json.dumps({"event": "ended", **result.document()}, sort_keys=True))
    else:
        for line in result_lines(result):
            say(line)
    if not result:
        account = result.account
        reasons = ", ".join(f"{reason}: {account.total(reason)}" for reason in account.lost if account.total(reason))
        parts = [f"{account.total()} messages are lost ({reasons})"] if account else []
        raise DataLossError("; ".join([*parts, *result.problems]))


def _leave() -> None:
    """End the process, but not by an exception, which would wait for whatever hangs, such as a disk."""
    sys.stderr.write("riot: ended at once; the file is readable up to its last chunk\n")
    sys.stderr.flush()
    os._exit(_INTERRUPTED)
