"""Monitors from nominal trials alone: what all of them have in common, wide enough that another one rarely differs."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Final

from riot_bus.monitors.arrivals import Rate, Ratio
from riot_bus.monitors.catalogue import build_monitor
from riot_bus.monitors.envelope import Envelope
from riot_bus.monitors.model import judge
from riot_bus.monitors.nominal import bounds_of, increases, topics_of, width_for
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.monitors.envelope import Bounds
    from riot_bus.monitors.model import Invariant, TrialView
    from riot_bus.monitors.nominal import TopicValues

__all__ = ["false_alarms", "from_json", "mine", "to_json"]

_ALARMS = 0.002  # of all bounds together, in a nominal trial
_LEAST_TRIALS = 3
_KINDS: Final = {Envelope: "envelope", Rate: "rate", Ratio: "count"}
_NORM_NOMINAL, _NORM_ALLOWED = 1e-3, 1e-2


def mine(views: Sequence[TrialView]) -> tuple[Invariant, ...]:
    """Return monitors that all these trials pass, by topic: fields, gaps, and outputs for an input.

    Args:
        views: Nominal trials, with all outputs that are to be watched; 5 to 20 are usual, more make bounds narrower.

    Raises:
        ConfigError: There are fewer than 3 trials.
    """
    if len(views) < _LEAST_TRIALS:
        raise ConfigError(
            f"{len(views)} nominal trials are too few to mine monitors from", hint=f"{_LEAST_TRIALS} at least"
        )
    runs = [topics_of(view) for view in views]
    shared = [name for name in runs[0] if all(name in run for run in runs) and _is_topic(name)]
    bounds = sum(2 * len(runs[0][name].fields) + 3 for name in shared)
    width = width_for(_ALARMS / max(bounds, 1), len(views))
    found: list[Invariant] = []
    for name in shared:
        topics = [run[name] for run in runs]
        if not any(topic.opaque for topic in topics):
            found.append(_envelope(name, topics, width))
        if min(len(topic.times) for topic in topics) > 1:
            found.append(_rate(name, topics, views, width))
        found.extend(_ratio(name, topics, views, width))
    return tuple(monitor for monitor in found if not any(judge(view, [monitor]).violations for view in views))


def false_alarms(monitors: Sequence[Invariant], views: Sequence[TrialView]) -> tuple[int, int]:
    """Return in how many nominal trials that nothing was mined from a monitor fires or fails, and of how many."""
    judged = [judge(view, monitors) for view in views]
    return sum(bool(each.violations or each.broken) for each in judged), len(judged)


def to_json(monitors: Sequence[Invariant]) -> str:
    """Return mined monitors as JSON: a list of tables as in `[[monitors]]` of riot.toml."""
    tables = [{"kind": _KINDS[type(monitor)], **asdict(monitor)} for monitor in monitors]  # type: ignore[call-overload]
    return json.dumps(tables, indent=1, allow_nan=False)


def from_json(text: str, *, where: str = "monitors") -> tuple[Invariant, ...]:
    """Return the monitors of a text that `to_json` has made.

    Args:
        text: The text.
        where: Where it is from, for errors.

    Raises:
        ConfigError: The text is no JSON, names another kind or a wrong option.
    """
    try:
        tables = json.loads(text)
    except ValueError as error:
        raise ConfigError(f"not JSON: {error}", where=where) from error
    known = _KINDS.values()
    if not isinstance(tables, list) or any(not isinstance(it, dict) or it.get("kind") not in known for it in tables):
        raise ConfigError(f"not a list of tables of kind {', '.join(known)}", where=where)
    return tuple(
        build_monitor(table, where=lambda key, number=number: f"{where}[{number}].{key}", root=Path())  # type: ignore[misc]
        for number, table in enumerate(tables)
    )


def _is_topic(name: str) -> bool:
    try:
        return parse_selector(name).topic == name
    except ConfigError:
        return False


def _envelope(name: str, topics: Sequence[TopicValues], width: float) -> Envelope:
    bounds: dict[str, Bounds] = {}
    increasing = []
    for path in topics[0].fields:
        fields = [topic.fields[path] for topic in topics if path in topic.fields]
        if len(fields) < len(topics) or not all(map(math.isfinite, (it for each in fields for it in each.values))):
            continue
        clock = all(each.clock for each in fields)
        if "[*]" not in path and increases(fields, width, clock=clock):
            increasing.append(path)
        bounds[path] = (None, None) if clock else bounds_of([each.values for each in fields], width)
    norms = {}
    for parent in topics[0].norms:
        signed = [length for topic in topics for length in topic.norms.get(parent, [0.0])]
        lengths, mean = [abs(length) for length in signed], fmean(map(abs, signed))
        members = [_range(topics, f"{parent}.{member}") for member in "xyz"]
        turns = signed[0] > 0 or max(members) > _NORM_ALLOWED * mean
        if mean > 0 and turns and max(abs(length - mean) for length in lengths) <= _NORM_NOMINAL * mean:
            norms[parent] = (mean, _NORM_ALLOWED * mean)
    return Envelope(name, bounds, tuple(increasing), norms)


def _range(topics: Sequence[TopicValues], path: str) -> float:
    values = [value for topic in topics for value in topic.fields[path].values]
    return max(values, default=0.0) - min(values, default=0.0)


def _rate(name: str, topics: Sequence[TopicValues], views: Sequence[TrialView], width: float) -> Rate:
    gaps = []
    for topic, view in zip(topics, views, strict=True):
        stamps = [view.start, *(time for time in topic.times if time >= view.start), view.end]
        gaps.append(max(after - before for before, after in pairwise(stamps)) / 1e9)
    logs = [math.log(max(gap, 1e-6)) for gap in gaps]  # how long a machine is late has a long tail
    usual, most = 3 * max(gaps) + 0.5, 20 * max(gaps) + 1
    return Rate(name, min(max(usual, math.exp(min(fmean(logs) + width * stdev(logs), 10.0))), most, 86_400.0))


def _ratio(name: str, topics: Sequence[TopicValues], views: Sequence[TrialView], width: float) -> Iterator[Ratio]:
    """Yield how many outputs come for an input of the topic whose number tells most about it."""
    counts: defaultdict[str, list[int]] = defaultdict(list)
    for view in views:
        seen: defaultdict[str, int] = defaultdict(int)
        for message in view.inputs:
            seen[view.registry.topic(message.key)] += 1
        for source, count in seen.items():
            counts[source].append(count)
    found = []
    for source, inputs in counts.items():
        if len(inputs) == len(views) and _is_topic(source):
            ratios = [len(topic.times) / count for topic, count in zip(topics, inputs, strict=True)]
            mean, spread = fmean(ratios), stdev(ratios)
            margin = max(width * spread, mean / 4, 3 / min(inputs))
            found.append((spread / mean, Ratio(name, source, max(0.0, mean - margin), mean + margin)))
    if found:
        yield min(found, key=lambda each: each[0])[1]
