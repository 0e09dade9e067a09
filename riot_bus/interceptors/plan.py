"""The interceptor that carries out an injection plan."""

from __future__ import annotations

from pathlib import Path

from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import read_plan


class Inject(Injector):
    """Carry out an injection plan.

    Args:
        plan: The plan's file.
        seed: Seed of everything random in it.
    """

    def __init__(self, plan: Path, seed: int = 0) -> None:
        super().__init__(read_plan(plan), seed=seed)
