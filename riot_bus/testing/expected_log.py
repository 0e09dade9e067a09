"""What was delivered in a test beside a log of what is expected."""

from __future__ import annotations

import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.log.comparison.compare import Wishes
from riot_bus.log.comparison.opening import Extract, compare_logs, opened
from riot_bus.log.comparison.tolerances import tolerances_of
from riot_bus.log.writer import LogWriter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.log.comparison.result import LogDifference
    from riot_bus.testing.capture import Capture
    from riot_bus.types.registry import TypeRegistry

__all__ = ["difference_from"]


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
) -> LogDifference:
    """Wait until as many messages have been delivered as a log has, then compare them with it.

    Args:
        expected: The log.
        capture: What was delivered.
        registry: Knows the types of messages.
        topics: Names or key expressions of what is compared; empty for all that the log has.
        exclude: Of what is not.
        tolerances: As of `riot diff`: files, or texts such as `/odom:pose.position.x=0.01`.
        timing: Seconds that messages may come earlier or later; None for any.
        order: Whether the order across topics has to be the same.
        timeout: Seconds to wait for each topic; what has not come by then is a difference.

    Raises:
        ConfigError: The log or a tolerance cannot be used, or nothing can be compared.
    """
    files = [Path(each) for each in tolerances if "=" not in str(each)]
    texts = [str(each) for each in tolerances if "=" in str(each)]
    wishes = Wishes(tolerances=tolerances_of(texts, files), timing=timing, order=order)
    extract = Extract(topics=topics, exclude=exclude)
    with opened([expected], extract) as (recording,):
        counts = {track.key: len(track) for track in recording.tracks.values()}
    deadline = time.monotonic() + timeout
    for key, count in counts.items():
        with suppress(AssertionError):  # what is missing is told by the comparison
            capture.wait_for(key, count, timeout=max(0.0, deadline - time.monotonic()))
    with tempfile.TemporaryDirectory(prefix="riot-") as name:
        came = Path(name) / "delivered.mcap"
        with LogWriter(came, registry=registry) as log:
            for one in capture.delivered("**"):
                if one.message.key in counts:
                    log.write(one.message)
        found = compare_logs(expected, came, wishes, extract=extract)
    if not any(counts.values()):
        found.check_compared()  # else it is a difference that nothing has come
    return found
