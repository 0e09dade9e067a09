"""Playback of logs with a comparison of the network's answers to the expected ones.

The answers are on the topics of the expected log that are not played.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.play.playback_plan import PlaybackPlan
from riot_bus.play.running import run_play
from riot_bus.record.options import CaptureOptions
from riot_bus.record.service import CaptureService
from riot_bus.types.serve import part_of
from riot_bus.vocabulary.errors import ConfigError, DataLossError
from riot_bus_logtools.comparison.compare import Wishes, compare
from riot_bus_logtools.comparison.opening import opened
from riot_bus_logtools.comparison.options import Extract

if TYPE_CHECKING:
    from riot_bus.control.terminal import Foreground
    from riot_bus.play.options import Expectation, PlayOptions
    from riot_bus_logtools.comparison.result import LogDifference

_TICK_S = 0.05
_MORE_S, _QUIET_S = 0.25, 2.0
"""Seconds without new messages that end the wait, if all answers have come, and if some have not."""
_MOST_KEYS = 100  # each is a subscription, of which a recording accepts 200; `**` takes the place of more


def play_expecting(
    options: PlayOptions, expectation: Expectation, foreground: Foreground, *, wishes: Wishes
) -> LogDifference | None:
    """Play logs, record the answers, and compare them with the expected ones.

    Returns:
        How the answers differ from the expected ones; None if the playback was interrupted.

    Raises:
        ConfigError: An option or a log is not usable, or no answer is expected.
        DataLossError: Messages could not be played, or answers not be recorded.
        EnvironmentFaultError: No router answers.
    """
    extract = Extract(topics=expectation.expect_topics, types=options.types, definitions=options.definitions)
    with ExitStack() as stack:
        (expected,) = stack.enter_context(opened([expectation.expect], extract))
        played = _played(options)
        tracks = [
            track
            for track in expected.tracks.values()
            if track.key not in played and track.topic not in played and part_of(track.key) is None
        ]
        if not tracks:
            hint = "choose what is played by --topics, or name a log that has answers as well"
            raise ConfigError(
                "none of the compared topics can hold answers: each is played, or is a service's",
                where=str(expectation.expect),
                hint=hint,
            )
        names = sorted({track.topic for track in tracks})
        foreground.warn(f"answers are expected on {', '.join(names)}")
        counts = Counter[str]()
        for track in tracks:
            counts[track.topic] += len(track)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="riot-answers-")))
        path = expectation.answers or folder / "answers.mcap"
        capture = CaptureOptions(
            endpoint=options.endpoint,
            config=options.config,
            keys=names if len(names) <= _MOST_KEYS else ["**"],
            output=path,
            overwrite=expectation.answers is None,
            durable=False,
            latched=False,
            graph=False,
            types=options.types,
            definitions=options.definitions,
            control=False,
        )
        with CaptureService(capture, warn=foreground.warn) as service:
            finished = run_play(options, foreground)
            if finished:
                _await(service, counts, expectation.expect_wait)
        if not finished:
            return None
        problems = service.result().problems
        if problems:
            raise DataLossError("; ".join(problems), where="the answers")
        only = Extract(topics=names, types=options.types, definitions=options.definitions)
        with opened([expectation.expect, path], only) as (expected, came):
            came.name = str(expectation.answers or "the answers")
            return compare(expected, came, wishes)


def _played(options: PlayOptions) -> set[str]:
    """Return the names and keys of the played topics, including those under which they were recorded."""
    plan = PlaybackPlan(options)
    cast = plan.cast
    plan.close()
    recorded = {name for topic in cast.topics.values() for name in (topic.key, topic.name)}
    return {*cast.offers, *cast.names.values(), *recorded, *([] if cast.clock is None else [cast.clock.name])}


def _await(service: CaptureService, counts: Mapping[str, int], most: float) -> None:
    """Wait until all answers have come and no more come, or nothing comes for longer, or the time is over."""
    deadline = time.monotonic() + most
    last, seen = time.monotonic(), -1
    while (now := time.monotonic()) < deadline:
        recorded = service.result().account.recorded
        total = sum(recorded.values())
        if total != seen:
            seen, last = total, now
        complete = all(recorded.get(topic, 0) >= count for topic, count in counts.items())
        if now - last >= (_MORE_S if complete else _QUIET_S) or service.wait(_TICK_S):
            return
