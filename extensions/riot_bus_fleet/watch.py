"""Live traffic compared with a rule, with warnings before the rule is met."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from riot_bus.chain.unit.prediction import column_of
from riot_bus.control.signals import ended_by_signals
from riot_bus.types.latest import LatestFields
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus_fleet.logs.near_misses import NearMiss
from riot_bus_fleet.scan import ScanRule

_NEARER, _LEFT = 0.5, 2.0
"""Within one approach, the next warning comes at half the distance; the approach ends at twice the warning distance."""


class RuleWatch:
    """Compares messages with a rule, one by one, and tells when they come nearer to it and when they meet it."""

    def __init__(self, rule: ScanRule, *, within: float, registry: TypeRegistry) -> None:
        self.judged = self.unknown = self.met = 0
        self.nearest: NearMiss | None = None
        self._rule, self._within = rule, within
        self._latest = LatestFields(rule.names, rule.topics, registry=registry, keeps=rule.keeps)
        self._limit = within

    def judge(self, message: Message) -> NearMiss | None:
        """Compare a message with the rule; return its moment if there is something to report."""
        values = self._latest.take(message)
        if values is None:
            return None
        if len(values) < len(self._rule.names):
            self.unknown += 1
            return None
        self.judged += 1
        (distance,) = self._rule.distance({name: column_of([values[name]]) for name in self._rule.names}, 1).tolist()
        moment = NearMiss(distance, message.time, {self._rule.in_words(name): one for name, one in values.items()})
        self.met += distance <= 0
        if self.nearest is None or distance < self.nearest.distance:
            self.nearest = moment
        if distance >= _LEFT * self._within:
            self._limit = self._within
        if distance >= self._limit:
            return None
        # once met, it is not reported again before the approach has ended
        self._limit = distance * _NEARER if distance > 0 else float("-inf")
        return moment

    def summary(self) -> str:
        """Return the result in one sentence."""
        if self.nearest is None:
            return f"nothing was judged: {counted(self.unknown, 'message')} of the rule's topics came"
        return (
            f"the rule was met at {self.met} of {counted(self.judged, 'message')}; nearest: {self.nearest.far}, "
            f"{self.nearest.told}"
        )


def watch_rule(
    source: Path,
    endpoint: str,
    *,
    within: float,
    say: Callable[[str], None],
    config: Mapping[str, Any] | None = None,
) -> RuleWatch:
    """Compare the messages that pass a router with a rule until a signal arrives.

    Args:
        within: Distance at which warnings begin, in nominal spreads.

    Raises:
        ConfigError: There is no rule.
        EnvironmentFaultError: No router answers at the endpoint.
    """
    rule, stop = ScanRule(source), threading.Event()
    registry = rule.registry()
    watch = RuleWatch(rule, within=within, registry=registry)

    def report(message: Message) -> None:
        moment = watch.judge(message)
        if moment is not None:
            say(f"{moment.time / 1e9:.3f} {'met' if moment.distance <= 0 else moment.far}: {moment.told}")

    with ended_by_signals(stop.set), open_client(endpoint, config=config) as client:
        for topic in rule.read:
            client.subscribe(registry.key_expression(topic), report)
        say(f"watching {', '.join(rule.read)} for {rule.text}")
        stop.wait()
    if client.lost:
        say(f"{client.lost.total()} messages came too fast and were not judged")
    return watch
