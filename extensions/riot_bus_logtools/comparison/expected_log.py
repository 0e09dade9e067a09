"""Comparison of the messages delivered in a test with a log of the expected ones."""

from __future__ import annotations

import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.log.writer import LogWriter
from riot_bus.types.serve import part_of
from riot_bus_logtools.comparison.compare import Wishes
from riot_bus_logtools.comparison.opening import compare_logs, opened
from riot_bus_logtools.comparison.options import Extract
from riot_bus_logtools.comparison.tolerances import tolerances_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.testing.capture import Capture
    from riot_bus.types.registry import TypeRegistry
    from riot_bus_logtools.comparison.result import LogDifference


def difference_from(
    expected: Path,
    capture: Capture,
    registry: TypeRegistry,
    *,
    topics: Sequence[str] = (),
    exclude: Sequence[str] = (),
    tolerances: Sequence[str | Path] = (),
    timing: float | None = None,
    order: bool = False,
    timeout: float = 10.0,
    types: Sequence[str] = (),
    definitions: Sequence[Path] = (),
) -> LogDifference:
    """Wait until as many messages have been delivered as a log contains, then compare them with it.

    The options are those of `riot diff`, tolerances files or texts; messages that have not been delivered after
    `timeout` seconds are differences. Calls of services are left out. Raises ConfigError if the log or a tolerance
    cannot be used, or nothing can be compared.
    """
    files = [Path(each) for each in tolerances if "=" not in str(each)]
    texts = [str(each) for each in tolerances if "=" in str(each)]
    wishes = Wishes(tolerances=tolerances_of(texts, files), timing=timing, order=order)
    extract = Extract(topics=topics, exclude=exclude, types=types, definitions=definitions)
    with opened([expected], extract) as (recording,):
        tracks = {key: track for key, track in recording.tracks.items() if part_of(key) is None}
        calls = recording.tracks.keys() - tracks.keys()
    extract = replace(extract, exclude=[*exclude, *sorted(calls)])
    deadline = time.monotonic() + timeout
    for track in tracks.values():
        with suppress(AssertionError):  # the comparison reports missing messages
            capture.wait_for(track.topic, len(track), timeout=max(0.0, deadline - time.monotonic()))
    delivered = [one.message for one in capture.delivered("**")]
    here = {message.key for message in delivered}
    names = {track.topic.strip("/") for key, track in tracks.items() if key not in here}
    wanted = {key for key in here if key in tracks or registry.topic(key).strip("/") in names}
    with tempfile.TemporaryDirectory(prefix="riot-") as name:
        came = Path(name) / "delivered.mcap"
        with LogWriter(came, registry=registry) as log:
            for message in delivered:
                if message.key in wanted:
                    log.write(message)
        found = compare_logs(expected, came, wishes, extract=extract)
    if not any(map(len, tracks.values())):
        found.check_compared()  # otherwise, having received nothing is itself a difference
    return found
