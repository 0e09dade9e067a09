"""The interceptor that carries out injections."""

from __future__ import annotations

import logging
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.inject.faults import fault_of
from riot_bus.pipeline.conditions import always, decider
from riot_bus.pipeline.runner import MOST_TOPICS
from riot_bus.types.elements import fit_value
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.injection import Curve, Formula, Signal

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.inject.faults import FaultKind
    from riot_bus.pipeline.event import Event
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.injection import Injection

_LOG = logging.getLogger(__name__)


class Injector:
    """Interceptor that carries out injections, the same ones for the same seed whatever the timing.

    A share of messages (`probability`) is chosen by the seeds, the injection's number, the message's content and its
    per-topic index, never by arrival order across topics. A message whose payload does not decode, or that lacks the
    field, is passed on, counted in `skipped` and reported once per topic (`problems`).

    Args:
        injections: Injections, carried out in this order.
        seed: The trial's seed; each injection's own seed is added to it.

    Raises:
        ConfigError: An injection sets nothing, or its predicate or formula does not parse.
    """

    name = "inject"

    def __init__(self, injections: Sequence[Injection], *, seed: int = 0) -> None:
        self.injections = tuple(injections)
        self.seed = seed
        self.topics = [injection.topic for injection in self.injections]
        self.hits: Counter[int] = Counter()
        """How often each injection (by number) was carried out."""
        self.skipped: Counter[str] = Counter()
        self.problems: dict[str, PayloadError] = {}
        self.ended: Callable[[], bool] = bool
        """Function that returns whether nothing is injected any more; asked at each message."""
        self._faults: list[FaultKind] = []
        for number, each in enumerate(self.injections):
            try:
                self._faults.append(fault_of(each))
            except ConfigError as error:
                raise ConfigError(error.message, where=error.where or f"inject[{number}]", hint=error.hint) from None
        self._decide = [
            # strict: a message that lacks the fields is reported, as one to which the fault cannot be applied
            decider(each, source=f"{seed}:{each.seed}:{number}", strict=True)
            for number, each in enumerate(self.injections)
        ]
        self._registry: TypeRegistry | None = None
        self._routes: dict[str, tuple[list[int], dict[int, list[int]]]] = {}
        self._rewriting: dict[str, int] = {}

    def load(self, registry: TypeRegistry) -> None:
        """Set the registry that tells which topics an expression matches."""
        self._registry = registry
        self._routes.clear()

    def message(self, event: Event) -> None:
        """Apply every injection that selects this message."""
        if self.ended():
            return
        key = event.key
        route = self._routes.get(key)
        if route is None:
            if len(self._routes) >= MOST_TOPICS:  # invented keys
                self._routes.clear()
            route = self._routes[key] = self._route(key)
        numbers, single = route
        if event.index in single:
            numbers = sorted([*numbers, *single[event.index]])
        for number in numbers:
            try:
                decide = self._decide[number]
                if decide is not always and not decide(event):
                    continue
                self._faults[number].apply(event)
            except PayloadError as error:
                self._skip(event.topic, error)
            else:
                self.hits[number] += 1
            if event.dropped:
                return

    def _route(self, key: str) -> tuple[list[int], dict[int, list[int]]]:
        """Return the numbers of the injections for a key, and those for a single message, by its index."""
        many: list[int] = []
        single: dict[int, list[int]] = {}
        for number, injection in enumerate(self.injections):
            if self._wants(number, key):
                alone = injection.first == injection.last
                (single.setdefault(injection.first, []) if alone else many).append(number)
        return many, single

    def rewriter(self, kind: MessageType | None, key: str, payload: bytes) -> Callable[[bytes], bytes] | None:
        """Return a patch of payloads if all messages of a key get the same value at the same place; see `Pipeline`."""
        numbers = [n for n in range(len(self.injections)) if self._wants(n, key)]
        patcher = getattr(kind, "patcher", None)
        if len(numbers) != 1 or kind is None or patcher is None:
            return None
        injection = self.injections[numbers[0]]
        value, path = injection.value, injection.field
        if (
            self.ended()
            or injection.fault != "set"
            or path is None
            or value is None
            or isinstance(value, Signal | Curve | Formula)
            or "[*]" in path
            or self._decide[numbers[0]] is not always
        ):
            return None
        try:
            patch: Callable[[bytes], bytes] | None = patcher(path, fit_value(value, kind.read(payload, path)))
        except PayloadError:
            return None
        if patch is not None:
            self._rewriting[key] = numbers[0]
        return patch

    def rewrote(self, key: str, count: int) -> None:
        """Count injections that were carried out by what `rewriter` returned."""
        number = self._rewriting.get(key)
        if number is not None:  # else another plan did that
            self.hits[number] += count

    def _wants(self, number: int, key: str) -> bool:
        assert self._registry is not None  # the pipeline has called `load`
        return self._registry.matches(self.injections[number].topic, key)

    def _skip(self, topic: str, error: PayloadError) -> None:
        self.skipped[topic] += 1
        if topic not in self.problems:
            self.problems[topic] = error
            _LOG.warning("%s: an injection cannot be carried out, messages pass as they are: %s", topic, error)
