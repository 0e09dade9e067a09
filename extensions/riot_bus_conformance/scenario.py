"""Scenarios: two ends, each in its own process, communicate over a few keys and report what they saw."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus_conformance.end import ScenarioEnd

PREFIX = "riot_transparency"
"""First chunk of every key, so that a suite on a network in use disturbs nothing."""

Need = Literal["router", "tls", "mtls", "password", "shm", "peer"]
"""What a scenario needs of the network.

`router`: a router that can be restarted; `tls`, `mtls`, `password`: a router that demands them; `shm`: shared memory;
`peer`: routers that introduce peers to each other, as every router does.
"""


@dataclass(frozen=True)
class Scenario:
    """Something that components do with a router.

    Attributes:
        limits: Documented differences: why the observations of a way differ from a plain router's.
    """

    name: str
    summary: str
    ends: type[ScenarioEnd]
    needs: frozenset[Need] = frozenset()
    settings: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.name

    @property
    def prefix(self) -> str:
        """Common prefix of all its keys."""
        return f"{PREFIX}/{self.name}"

    @property
    def keys(self) -> tuple[str, ...]:
        """The key expressions that it uses."""
        return (f"{self.prefix}/**",)


_REGISTRY: dict[str, Scenario] = {}


def scenario(
    name: str,
    summary: str | None = None,
    *,
    needs: tuple[Need, ...] = (),
    settings: Mapping[str, Any] | None = None,
    limits: Mapping[str, str] | None = None,
) -> Callable[[type[ScenarioEnd]], type[ScenarioEnd]]:
    """Register a class with the methods `left` and `right` as a scenario; one class may be several scenarios.

    Args:
        name: Unique name; also a chunk of its keys.
        summary: Description of what it does, in one line; None for the docstring of the class.
    """

    def register(ends: type[ScenarioEnd]) -> type[ScenarioEnd]:
        if name in _REGISTRY:
            raise ValueError(f"two scenarios are named {name!r}")
        text = summary or (ends.__doc__ or "").strip()
        _REGISTRY[name] = Scenario(name, text, ends, frozenset(needs), settings or {}, limits or {})
        return ends

    return register


def load() -> dict[str, Scenario]:
    """Return all scenarios by name, in the order of their modules."""
    from riot_bus_conformance import scenarios

    for module in pkgutil.iter_modules(scenarios.__path__):
        importlib.import_module(f"{scenarios.__name__}.{module.name}")
    return dict(_REGISTRY)


def find(name: str) -> Scenario:
    """Return the scenario of this name; raises ConfigError if there is none."""
    known = load()
    if name not in known:
        raise ConfigError(f"no scenario {name!r}", hint=did_you_mean(name, known))
    return known[name]
