"""The interceptor that carries out an injection plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import read_plan

if TYPE_CHECKING:
    from riot_bus.pipeline.event import Event
    from riot_bus.types.registry import TypeRegistry

__all__ = ["Inject"]


@dataclass
class Inject:
    """Carry out an injection plan.

    Args:
        plan: The plan's file.
        seed: Seed of everything random in it.
    """

    name: ClassVar[str] = "inject"
    plan: Path
    seed: int = 0

    def __post_init__(self) -> None:
        self.injector = Injector(read_plan(self.plan), seed=self.seed)
        self.topics = self.injector.topics

    def load(self, registry: TypeRegistry) -> None:
        """Set the registry that tells which topics an expression matches."""
        self.injector.load(registry)

    def message(self, event: Event) -> None:
        """Apply every injection that selects this message."""
        self.injector.message(event)
