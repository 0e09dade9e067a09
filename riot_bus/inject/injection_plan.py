"""An injection plan with the interceptor that carries it out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import parse_plan, plan_text
from riot_bus.vocabulary.errors import ConfigError


@dataclass(frozen=True, slots=True)
class InjectionPlan:
    """An injection plan that is carried out: its name for users (the path of its file), text and injector."""

    name: str
    text: str
    injector: Injector

    @classmethod
    def parse(cls, text: str, name: str, *, seed: int = 0) -> InjectionPlan:
        """Read a plan; the seed of the run is added to the plan's own.

        Raises:
            ConfigError: It is not a plan, or an empty one.
        """
        injections = parse_plan(text, name=name)
        if not injections:
            raise ConfigError(
                "this plan injects nothing", where=name, hint="add [[inject]] tables (docs/interceptors.md)"
            )
        return cls(name, text, Injector(injections, seed=seed))

    @classmethod
    def read(cls, path: Path, *, seed: int = 0) -> InjectionPlan:
        """Read a plan's file; see `parse`.

        Raises:
            ConfigError: The file cannot be read, or it is not a plan.
        """
        return cls.parse(plan_text(path), str(path), seed=seed)
