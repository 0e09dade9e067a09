"""What all trials of one system share: its file, its types, its monitors."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError
from riot_bus.monitors.invariants import Finite, Range, Rate
from riot_bus.monitors.liveness import CrashMonitor, HangMonitor
from riot_bus.selector import parse_selector
from riot_bus.sut.system import FiniteMonitor, RangeMonitor, RateMonitor, SystemFile, load_system
from riot_bus.types.registry import TypeRegistry, chosen_adapters, load_adapters

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus.monitors.model import Monitor

__all__ = ["Context", "open_system"]


@dataclass(frozen=True, slots=True)
class Context:
    """A system that is ready to be tested."""

    file: SystemFile
    registry: TypeRegistry
    monitors: tuple[Monitor, ...]

    @property
    def watched(self) -> list[str]:
        """Topics that the invariants of riot.toml look at."""
        settings = self.file.monitors
        return sorted(
            {parse_selector(one.topic if isinstance(one, RateMonitor) else one.field).topic for one in settings}
        )

    @property
    def profile(self) -> str:
        """MCAP profile of this system's logs."""
        topics = [topic for part in self.file.components.values() for topic in (*part.inputs, *part.outputs)]
        return "ros2" if any(topic.startswith("/") for topic in topics) else ""

    def topics(self, *names: str) -> list[str]:
        """Return the Zenoh key expressions that topic names stand for."""
        return [self.registry.key_expression(name) for name in names]

    def fingerprint(self) -> str:
        """Return a hash of the system file and of the sources that it names; trials are only reused while it holds."""
        digest = hashlib.sha256(self.file.model_dump_json(exclude={"path"}).encode())
        for pattern in self.file.system.sources:
            for path in sorted(self.file.root.glob(pattern)):
                if path.is_file():
                    digest.update(str(path.relative_to(self.file.root)).encode())
                    digest.update(path.read_bytes())
        return digest.hexdigest()[:16]


def open_system(path: Path) -> Context:
    """Read a system file and load the adapters and message types that it names.

    Raises:
        ConfigError: Something in it is not usable; with place and suggestion.
    """
    file = load_system(path)
    adapters = load_adapters(chosen_adapters(file.system.adapters))
    files = []
    for name in file.system.messages:
        source = (file.root / name).resolve()
        if not source.is_file():
            raise ConfigError(f"no such file: {name!r}", where=f"{file.path}: [system] messages")
        files.append(source)
    registry = TypeRegistry(adapters, declared=file.system.types, definitions=files)
    monitors: list[Monitor] = [CrashMonitor(), HangMonitor()]
    for settings in file.monitors:
        if isinstance(settings, RangeMonitor):
            monitors.append(Range(settings.field, low=settings.min, high=settings.max))
        elif isinstance(settings, FiniteMonitor):
            monitors.append(Finite(settings.field))
        else:
            monitors.append(Rate(settings.topic, gap=settings.gap))
    return Context(file, registry, tuple(monitors))
