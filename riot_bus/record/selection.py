"""Selection of the keys that are recorded, and the rules for each of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.record.options import parse_throttles
from riot_bus.record.subscriber import KeyRules
from riot_bus.zenoh.session import canonical, includes

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.record.options import CaptureOptions
    from riot_bus.record.trigger import Trigger
    from riot_bus.types.registry import TypeRegistry

_MOST_WARNINGS = 20  # any client may invent topics: bounds the lines on stderr and the memory
_MOST_NAMED = 100  # each is compared with every new key; silent ones are lines of the result


class RecordingSelection:
    """Selection of what is recorded; thread-safe.

    Attributes:
        expressions: Canonical key expressions to subscribe to; none includes another.

    Raises:
        ConfigError: A key expression is invalid.
    """

    def __init__(
        self, options: CaptureOptions, *, registry: TypeRegistry, trigger: Trigger, warn: Callable[[str], None]
    ) -> None:
        wanted = canonical([registry.key_expression(each) for each in options.keys])
        self.expressions = [
            each for each in wanted if not any(other != each and includes(other, each) for other in wanted)
        ]
        canonical([registry.key_expression(each) for each in options.exclude])
        self._exclude, self._bag = tuple(options.exclude), options.bag
        self._registry, self._trigger, self._warn = registry, trigger, warn
        self._throttles = {topic: round(1e9 / hertz) for topic, hertz in parse_throttles(options.throttle).items()}
        self._strange: set[str] = set()
        self._foreign: set[str] = set()
        named = [each for each in options.keys if each != "**"]
        self._unheard = dict.fromkeys(named if len(named) <= _MOST_NAMED else ())

    def learnt(self, key: str) -> None:
        """Report that the type of a key has become known, if it was reported as unknown."""
        topic = self._registry.topic(key)
        if topic in self._strange:
            self._strange.discard(topic)
            self._warn(
                f"the type of {topic} has been told by its nodes and is recorded with its definition from now on"
            )

    def silent(self) -> list[str]:
        """Return the names and key expressions without any message; empty if more than a hundred were given."""
        return list(self._unheard)

    def rules(self, key: str) -> KeyRules | None:
        """Return the rules for a key on which a message has come, None if it is not recorded."""
        registry = self._registry
        for each in tuple(self._unheard):
            if registry.matches(each, key):
                self._unheard.pop(each, None)
        if any(registry.matches(each, key) for each in self._exclude):
            return None
        adapter = registry.metadata_adapter(key)
        if self._bag and adapter is None:
            if key not in self._foreign and len(self._foreign) < _MOST_WARNINGS:
                self._foreign.add(key)
                self._warn(f"{key} is not a topic of ROS 2 and is not recorded, since a bag cannot hold it")
            return None
        topic = registry.topic(key)
        strange = adapter is not None and topic not in self._strange and len(self._strange) < _MOST_WARNINGS
        if adapter is not None and strange and registry.type_of(key) is None:
            self._strange.add(topic)
            definition = adapter.definition(key)
            name = definition[0].name if definition is not None else "its type"
            self._warn(f"{name} of {topic} is unknown here and recorded without its definition; name it with --msg")
        least = [period for each, period in self._throttles.items() if registry.matches(each, key)]
        return KeyRules(
            topic,
            stamp=adapter.stamp if adapter is not None else None,
            least_ns=max(least, default=0),
            trigger=self._trigger.for_key(key),
        )
