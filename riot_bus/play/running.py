"""`riot play`: plays until the end or until told to stop, then says what happened."""

from __future__ import annotations

import gc
import sys
import threading
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING

from riot_bus.control.signals import ended_by_signals
from riot_bus.play.keys import HELP, key_actions
from riot_bus.play.service import SHOWN, PlayService
from riot_bus.play.text import progress_line, result_line, speed
from riot_bus.vocabulary.errors import DataLossError
from riot_bus.vocabulary.redaction import escape_control_chars, redacted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus.control.terminal import Foreground
    from riot_bus.play.options import PlayOptions


def run_play(options: PlayOptions, foreground: Foreground) -> bool:
    """Play, then report the result; return False if a signal has ended it.

    Raises:
        ConfigError: An option is wrong.
        EnvironmentFaultError: No router answers.
        DataLossError: Messages could not be read or published.
    """
    service = PlayService(options, warn=lambda line: foreground.warn(escape_control_chars(f"warning: {line}")))
    interrupted = threading.Event()

    def end() -> None:
        interrupted.set()
        service.stop()

    try:
        with ended_by_signals(end), _punctual(), service:
            topics = sorted(service.programme.cast.names.values())
            started = {"player": service.name, "topics": topics, "status": service.status()}
            foreground.report("started", started, [_ready(service)])
            foreground.attend(
                service.wait, keys=HELP, actions=key_actions(service), line=lambda: progress_line(service.status())
            )
            result = service.result()
    finally:
        service.close()
    foreground.report("ended", asdict(result), [result_line(result)])
    foreground.warn_of_errors(service.programme.pipeline)
    if not result:
        parts = [f"{path}: {loss}" for path, loss in result.unread.items()]
        if result.lost:
            lost = ", ".join(f"{topic} {number}" for topic, number in result.lost.most_common(SHOWN))
            parts.append(f"{result.lost.total()} messages were not published: {lost}")
        parts += [f"{topic}: {problem}" for topic, problem in list(result.problems.items())[:SHOWN]]
        raise DataLossError(escape_control_chars("; ".join(parts)), hint=service.programme.hint)
    return not interrupted.is_set()


def _ready(service: PlayService) -> str:
    options, status = service.options, service.status()
    logs, length = ", ".join(map(str, options.logs)), status["end"] - status["start"]
    count, where = len(service.programme.cast.names), redacted(options.endpoint)
    return escape_control_chars(
        f"{service.name}: {count} topics of {logs}, {length:.1f} s, {speed(options.rate)}, to {where}"
    )


@contextmanager
def _punctual() -> Iterator[None]:
    """Switch threads more often than every 5 ms, and exclude existing objects from garbage collection."""
    former = sys.getswitchinterval()
    sys.setswitchinterval(2e-4)  # with Python's 5 ms, another busy thread makes a message late by as much
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(former)
