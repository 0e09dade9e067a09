"""Answers from a unit's log to the services that it calls when it is tested alone."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from riot_bus.log.reader import LogReader
from riot_bus.router.services.recorded import RecordedCall, RecordedService, calls_in
from riot_bus.types.serve import PARTS
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.trial.context import Context
    from riot_bus.trial.network import TrialNetwork


def serve_calls(network: TrialNetwork, context: Context, unit: str) -> None:
    """Answer the calls that a unit makes; raises as `calls_of_unit`."""
    segment = network.segment_of(context.file.component_of(unit))
    for number, (key, calls) in enumerate(calls_of_unit(context, unit).items(), start=1):
        network.serve(segment, key, RecordedService(calls), number=number)


def calls_of_unit(context: Context, unit: str) -> Mapping[str, Sequence[RecordedCall]]:
    """Return the recorded calls of the services that a unit calls, by key.

    Raises:
        ConfigError: The log has no answered call of one of the services, or riot.toml names no log.
    """
    file = context.file
    described = file.unit[unit]
    name = file.component_of(unit)
    services = file.components[name].calls
    if not services:
        return {}
    where, log = f"{file.path}: [components.{name}] calls", described.log or file.system.nominal
    hint = "record one with `riot router --record --intercept-services ...`"
    if log is None:
        raise ConfigError("no log is named that could have the calls of a service", where=where, hint=hint)
    path = file.root / log
    expressions = tuple(context.registry.key_expression(f"{service}/{part}") for service in services for part in PARTS)
    found = _calls(path, path.stat().st_mtime_ns, expressions)
    names = {context.registry.topic(key): key for key in found} | {key: key for key in found}
    for service in services:
        if service not in names and not any(context.registry.matches(service, key) for key in found):
            near = did_you_mean(service, names)
            raise ConfigError(f"{path} has no call of {service!r} with a reply", where=where, hint=near or hint)
    return found


@functools.lru_cache(maxsize=4)
def _calls(path: Path, changed: int, expressions: tuple[str, ...]) -> Mapping[str, Sequence[RecordedCall]]:
    """Return the calls of a log, which are the same for all trials as long as it has not `changed`."""
    with LogReader(path) as reader:
        return calls_in(reader.messages(topics=expressions))
