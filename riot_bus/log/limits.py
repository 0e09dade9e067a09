"""Limits of what is read of a log: default ones, tighter ones for a robot, and how both are lifted."""

from __future__ import annotations

import os
from dataclasses import fields, replace
from typing import TYPE_CHECKING

from riot_bus.config.arguments import parse_size
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from riot_bus.log.engine.limits import BeyondLimitError

VARIABLE = "RIOT_LOG_LIMITS"
_TIGHT = LogLimits(
    chunk=1 << 27, loose=1 << 24, total=1 << 28, chunks=1 << 16, messages=1 << 18, held=1 << 26, definitions=1 << 23
)


def lifted(limits: LogLimits = DEFAULT_LIMITS) -> LogLimits:
    """Return limits with the changes in the environment's `RIOT_LOG_LIMITS`, such as `ratio=1000,chunk=2GiB`.

    Raises:
        ConfigError: A limit is unknown, or its value is not valid.
    """
    wanted: dict[str, int] = {}
    for text in filter(None, map(str.strip, os.environ.get(VARIABLE, "").split(","))):
        name, _, value = text.partition("=")
        known = [each.name for each in fields(LogLimits)]
        if name not in known:
            raise ConfigError(f"unknown limit {name!r}", where=VARIABLE, hint=did_you_mean(name, known))
        wanted[name] = parse_size(value, VARIABLE)
    return replace(limits, **wanted) if wanted else limits


def tight_limits(files: int = 1) -> LogLimits:
    """Return limits for a robot's agent, whose unit has 2 GB; the environment changes these, too."""
    share, hour = max(1, files), 3600  # at a chunk a second, for each file, however many share the limit
    return lifted(replace(_TIGHT, chunks=max(hour, _TIGHT.chunks // share), held=_TIGHT.held // share))


def refusal(error: BeyondLimitError) -> str:
    """Return a sentence that tells what is beyond which limit, and how to lift it."""
    return f"{error}; {VARIABLE}={error.lift} lifts that"
