"""`riot play`: plays until the end or until told to stop, then says what happened."""

from __future__ import annotations

import gc
import json
import sys
import threading
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.control.signals import ended_by_signals
from riot_bus.control.terminal import Foreground
from riot_bus.play.keys import HELP, press
from riot_bus.play.service import PlayService
from riot_bus.play.text import progress_line, result_line, speed
from riot_bus.vocabulary.errors import DataLossError
from riot_bus.vocabulary.redaction import escape_control_chars, redacted

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractContextManager

    from riot_bus.control.terminal import Console
    from riot_bus.play.options import PlayOptions
    from riot_bus.play.service import PlayResult

__all__ = ["run_play"]

_SWITCH_S = 2e-4  # with Python's 5 ms, another busy thread makes a message late by as much


def run_play(
    options: PlayOptions,
    *,
    say: Callable[[str], None],
    warn: Callable[[str], None],
    console: AbstractContextManager[Console] | None = None,
    as_json: bool = False,
) -> bool:
    """Play, then report the result.

    Args:
        options: Logs, and how they are played.
        say: Function that prints a line of the result.
        warn: Function that prints a line of diagnostics.
        console: Terminal that shows progress and takes keys during playback; None if there is no terminal.
        as_json: Whether to print lines of JSON.

    Returns:
        False if a signal has ended it.

    Raises:
        ConfigError: An option is wrong.
        EnvironmentFaultError: No router answers.
        DataLossError: Messages could not be read or published.
    """
    foreground = Foreground(console, warn)
    service = PlayService(options, warn=lambda line: foreground.tell(escape_control_chars(f"warning: {line}")))
    interrupted = threading.Event()

    def end() -> None:
        interrupted.set()
        service.stop()

    try:
        with ended_by_signals(end), _punctual(), service:
            say(_ready(service, as_json=as_json))
            foreground.attend(
                service.wait, keys=HELP, press=partial(press, service), line=lambda: progress_line(service.status())
            )
            result = service.result()
    finally:
        service.close()
    _end(service, result, say, warn, as_json=as_json)
    return not interrupted.is_set()


def _ready(service: PlayService, *, as_json: bool) -> str:
    options, topics = service.options, sorted(service.programme.cast.names.values())
    if as_json:
        started = {"event": "started", "player": service.name, "topics": topics, "status": service.status()}
        return json.dumps(started, sort_keys=True)
    status = service.status()
    logs = ", ".join(str(path) for path in options.logs)
    length, where = status["end"] - status["start"], redacted(options.endpoint)
    return escape_control_chars(
        f"{service.name}: {len(topics)} topics of {logs}, {length:.1f} s, {speed(options.rate)}, to {where}"
    )


def _end(
    service: PlayService,
    result: PlayResult,
    say: Callable[[str], None],
    warn: Callable[[str], None],
    *,
    as_json: bool,
) -> None:
    say(json.dumps({"event": "ended", **asdict(result)}, sort_keys=True) if as_json else result_line(result))
    pipeline = service.programme.pipeline
    for name, errors in pipeline.errors.items() if pipeline is not None else ():
        warn(f"interceptor {name} raised {errors.count} times; the messages went on without it. First:\n{errors.first}")
    if not result:
        parts = [f"{path}: {loss}" for path, loss in result.unread.items()]
        if result.lost:
            topics = ", ".join(f"{topic} {number}" for topic, number in result.lost.most_common(5))
            parts.append(f"{result.lost.total()} messages were not published: {topics}")
        parts += [f"{topic}: {problem}" for topic, problem in list(result.problems.items())[:5]]
        raise DataLossError(escape_control_chars("; ".join(parts)), hint=service.programme.hint)


@contextmanager
def _punctual() -> Iterator[None]:
    """Switch threads more often than every 5 ms, and exclude existing objects from garbage collection."""
    former = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(former)
