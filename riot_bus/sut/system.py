"""The system file `riot.toml`: what the system is made of, what the outside controls, and what counts as a failure."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from riot_bus.errors import ConfigError, did_you_mean

__all__ = [
    "Component",
    "External",
    "FiniteMonitor",
    "MonitorSettings",
    "Pace",
    "RangeMonitor",
    "RateMonitor",
    "Ready",
    "Settle",
    "System",
    "SystemFile",
    "Unit",
    "load_system",
]

Seconds = Annotated[float, Field(gt=0, le=86_400)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Pace(_Table):
    """How long a run of the whole system lasts, and how fast: {duration} and {speed} in commands."""

    duration: Seconds
    speed: float = Field(default=1.0, gt=0)


class System(_Table):
    """`[system]`: name, segments, message types, and how long runs of the whole system last."""

    name: str = "system"
    segments: tuple[str, ...] = ("system",)
    nominal: str | None = None
    messages: tuple[str, ...] = ()
    types: dict[str, str] = {}
    adapters: tuple[str, ...] | None = None
    sources: tuple[str, ...] = ()
    nominal_run: Pace = Pace(duration=60.0)
    trial_run: Pace = Pace(duration=10.0)
    perturbed_run: Pace = Pace(duration=30.0)


class Ready(_Table):
    """How long a component may take to subscribe to its inputs."""

    timeout: Seconds = 15.0


class Component(_Table):
    """`[components.NAME]`: one process.

    `command`, `env` and `cwd` may contain {python} {endpoint} {segment} {trial_dir} {seed} {duration}
    {speed}.
    """

    command: tuple[str, ...] = Field(min_length=1)
    segment: str | None = None
    env: dict[str, str] = {}
    cwd: str = "."
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    external: bool = False
    ready: Ready = Ready()
    stop: Literal["kill", "term"] = "kill"
    tracebacks: Literal["fail", "ignore"] = "fail"


class External(_Table):
    """`[external]`: topics that the outside world controls, ranges of their fields, and fields that it does not."""

    topics: tuple[str, ...] = ()
    ranges: dict[str, tuple[float, float]] = {}
    exclude: tuple[str, ...] = ()


class Settle(_Table):
    """When a unit counts as settled (no activity for `window` seconds) and when as hanging (`timeout`).

    `linger` is the time that it may take to die once it has come to rest.
    """

    window: Seconds = 0.03
    linger: Seconds = 0.25
    timeout: Seconds = 10.0


class Unit(_Table):
    """`[unit.NAME]`: a component under test on its own."""

    component: str | None = None
    log: str | None = None
    rate: float = Field(default=0.0, ge=0)
    settle: Settle = Settle()
    dictionaries: tuple[str, ...] = ()
    leave: tuple[str, ...] = ()
    include: tuple[str, ...] = ()


class RangeMonitor(_Table):
    """A field of an output stays within bounds."""

    kind: Literal["range"]
    field: str
    min: float | None = None
    max: float | None = None


class FiniteMonitor(_Table):
    """A field of an output is neither NaN nor infinite."""

    kind: Literal["finite"]
    field: str


class RateMonitor(_Table):
    """An output comes at least every `gap` seconds of wall time."""

    kind: Literal["rate"]
    topic: str
    gap: Seconds


MonitorSettings = Annotated[RangeMonitor | FiniteMonitor | RateMonitor, Field(discriminator="kind")]


class SystemFile(_Table):
    """A whole riot.toml."""

    system: System = System()
    components: dict[str, Component] = Field(min_length=1)
    external: External = External()
    monitors: tuple[MonitorSettings, ...] = ()
    unit: dict[str, Unit] = {}
    path: Path = Path("riot.toml")

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        for name, component in self.components.items():
            if component.segment is not None and component.segment not in self.system.segments:
                raise _unknown(f"components.{name}.segment", component.segment, self.system.segments)
        for name, unit in self.unit.items():
            if (unit.component or name) not in self.components:
                place = f"unit.{name}.component" if unit.component else f"unit.{name}"
                raise _unknown(place, unit.component or name, self.components)
        return self

    @property
    def root(self) -> Path:
        """The folder that relative paths start from."""
        return self.path.parent

    def segment_of(self, component: Component) -> str:
        """Return the segment that a component connects to."""
        return component.segment or self.system.segments[0]

    def choose_unit(self, name: str | None) -> str:
        """Return the unit to test: the named one, or the only one.

        Raises:
            ConfigError: There is no such unit, or several and none was named.
        """
        if name is None and len(self.unit) == 1:
            return next(iter(self.unit))
        if name is None:
            hint = "add a [unit.NAME] table" if not self.unit else f"choose with --unit: {', '.join(sorted(self.unit))}"
            raise ConfigError(f"{len(self.unit)} units are described", where=str(self.path), hint=hint)
        if name not in self.unit:
            raise ConfigError(f"no unit {name!r}", where=str(self.path), hint=did_you_mean(name, self.unit))
        return name


def _unknown(place: str, word: str, known: Any) -> ValueError:
    return ValueError(f"{place}|{word!r} is not described|{did_you_mean(word, known) or ''}")


def load_system(path: Path) -> SystemFile:
    """Read and check a system file.

    Raises:
        ConfigError: Missing file, TOML syntax error, unknown key or bad value; with place and suggestion.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"cannot read the system file: {error.strerror}",
            where=str(path),
            hint="name one with --system, or see examples/rover/riot.toml",
        ) from None
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(str(error), where=str(path), hint="this is not valid TOML") from None
    if "path" in document:
        raise ConfigError("unknown key 'path'", where=f"{path}:{_line(text, ['path'])}")
    try:
        return SystemFile.model_validate({**document, "path": path.resolve()})
    except ValidationError as error:
        raise _explained(error, path, text) from None


def _explained(error: ValidationError, path: Path, text: str) -> ConfigError:
    problem = error.errors()[0]
    place = [str(part) for part in problem["loc"]]
    hint = None
    if problem["type"] == "value_error":
        dotted, message, hint = (str(problem["msg"]).removeprefix("Value error, ") + "||").split("|")[:3]
        place = dotted.split(".")
    elif problem["type"] == "extra_forbidden":
        message = f"unknown key {place[-1]!r}"
        hint = did_you_mean(place[-1], _known_keys(place[:-1]))
    else:
        message = f"{problem['msg']} (got {problem.get('input')!r})"
        if problem["type"] == "missing":
            message = f"key {place[-1]!r} is missing"
    line = _line(text, place)
    where = f"{path}:{line}: [{'.'.join(place[:-1])}]" if len(place) > 1 else f"{path}:{line}"
    return ConfigError(message, where=where, hint=hint or None)


def _known_keys(place: list[str]) -> list[str]:
    tables: dict[str, type[BaseModel]] = {
        "": SystemFile,
        "system": System,
        "components": Component,
        "external": External,
        "unit": Unit,
        "settle": Settle,
        "nominal_run": Pace,
        "trial_run": Pace,
        "perturbed_run": Pace,
        "ready": Ready,
        "range": RangeMonitor,
        "finite": FiniteMonitor,
        "rate": RateMonitor,
    }
    for name in reversed(place or [""]):
        if name in tables:
            return [key for key in tables[name].model_fields if key != "path"]
    return []


def _line(text: str, place: list[str]) -> int:
    """Return the line that a key most likely stands on: its table's header first, then the key itself."""
    lines = text.splitlines()
    names = [part for part in place if not part.isdigit()]
    at = 0
    for depth in range(len(names), 0, -1):
        header = ".".join(names[:depth])
        for number, line in enumerate(lines):
            if line.strip().strip("[]").strip().replace('"', "") == header:
                at = number
                break
        else:
            continue
        break
    if names:
        for number in range(at, len(lines)):
            if lines[number].split("=")[0].strip().strip("\"'") == names[-1]:
                return number + 1
    return at + 1
