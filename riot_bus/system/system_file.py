"""The system file `riot.toml`: what the system is made of, what the outside controls, and what counts as a failure."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from riot_bus.config.arguments import parse_seconds, parse_size
from riot_bus.config.router_settings import RouterSettings, router_keys
from riot_bus.config.toml_file import MistakeError, explained, line_of, place_of, read_toml
from riot_bus.monitors.catalogue import build_monitor
from riot_bus.monitors.model import Invariant
from riot_bus.monitors.selection import message_selector
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

Seconds = Annotated[float, Field(gt=0, le=86_400)]

PARAMETER = re.compile(r"\{param:([^{}]*)\}")
FILE = re.compile(r"\{file:([^{}]+)\}")
FREE_PORT = re.compile(r"\{free_port(?::\w{1,40})?\}", re.ASCII)
"""Placeholders of a port: with a name, there is one for each."""
_PLACEHOLDER = re.compile(r"(?<!\{)\{([a-z_]+)(:[^{}]*)?\}(?!\})", re.ASCII)
_PLACEHOLDERS = (
    "python",
    "endpoint",
    "segment",
    "trial_dir",
    "seed",
    "duration",
    "speed",
    "slot",
    "domain",
    "free_port",
)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    with_placeholders: ClassVar[tuple[str, ...]] = ()
    """Fields whose texts may have placeholders."""

    def filled(self, fill: Callable[[str], str]) -> Self:
        """Return a copy with placeholders filled in, by a function from text to text."""
        return self.model_copy(update={name: _filled(getattr(self, name), fill) for name in self.with_placeholders})


def _filled(value: Any, fill: Callable[[str], str]) -> Any:
    """Return a value of a table with `fill` applied to all texts in it."""
    match value:
        case str():
            return fill(value)
        case tuple():
            return tuple(fill(text) for text in value)
        case dict():
            return {key: fill(text) for key, text in value.items()}
        case _Table():
            return value.filled(fill)
    return value


def _texts(value: Any) -> list[str]:
    """Return all texts in a value of a table that may have placeholders."""
    found: list[str] = []
    _filled(value, lambda text: found.append(text) or text)  # type: ignore[func-returns-value]
    return found


class RunPace(_Table):
    """Duration and speed of a run of the whole system: {duration} and {speed} in commands."""

    duration: Seconds
    speed: float = Field(default=1.0, gt=0)


class Reset(_Table):
    """The reset of processes that are kept over trials to their first state, before each trial except the first.

    A message is published, or a command is executed, which may contain {python} {trial_dir} {slot} {free_port:NAME}.
    """

    topic: str | None = Field(default=None, min_length=1)
    payload: str = Field(default="", max_length=65_536)
    encoding: str = ""
    command: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.topic is None) == (not self.command):
            raise MistakeError("give either topic = TOPIC or command = [PROGRAM, ARGUMENT, ...]")
        return self


class VirtualClock(_Table):
    """`[system.clock]`: in runs that the nominal log drives, time advances when all components are at rest.

    The virtual time is published on `topic` each `step` seconds, if given. With `reset`, processes are kept over runs.
    """

    topic: str | None = Field(default=None, min_length=1)
    step: Annotated[float, Field(ge=0.001, le=3600)] = 0.01
    reset: Reset | None = None


class System(_Table):
    """`[system]`: name, segments, message types, surroundings of trials, and how long runs of the whole system last."""

    name: str = "system"
    segments: tuple[str, ...] = ("system",)
    nominal: str | None = None
    messages: tuple[str, ...] = ()
    types: dict[str, str] = {}
    adapters: tuple[str, ...] | None = None
    sources: tuple[str, ...] = ()
    surroundings: Literal["fixed", "as they are"] = "fixed"
    nominal_run: RunPace = RunPace(duration=60.0)
    trial_run: RunPace = RunPace(duration=10.0)
    perturbed_run: RunPace = RunPace(duration=30.0)
    clock: VirtualClock | None = None
    reset: Reset | None = None


def _checked(check: Callable[[Any], object]) -> Callable[[Any], Any]:
    """Return a validator that returns values as they are, if `check` raises no ConfigError."""

    def validate(value: Any) -> Any:
        try:
            check(value)
        except ConfigError as error:
            raise MistakeError(error.message, hint=error.hint) from None
        return value

    return validate


def _service(text: str) -> str:
    """Return the name of a service unchanged; raise MistakeError for any other text."""
    if not re.fullmatch(r"/?[^/*$?#\s]+(/[^/*$?#\s]+)*", text):
        hint = "write its key or ROS name, without wildcards"
        raise MistakeError(f"{text!r} is not the name of a service", hint=hint)
    return text


class Ready(_Table):
    """Conditions for feeding a component, besides that it has subscribed to its inputs.

    `line` is part of a line that it prints, `topic` one on which it has published (a selector may say what), `service`
    one that it offers, `port` one of TCP at which it listens on this machine, `after` a time since its start, `command`
    one that is executed until it ends with status 0. All conditions have to be met within `timeout` seconds.
    """

    timeout: Seconds = 15.0
    line: str | None = Field(default=None, min_length=1, max_length=1000)
    topic: Annotated[str, AfterValidator(_checked(message_selector))] | None = None
    service: Annotated[str, Field(max_length=1000), AfterValidator(_service)] | None = None
    port: Annotated[int, Field(ge=1, le=65_535)] | Annotated[str, Field(pattern=f"^{FREE_PORT.pattern}$")] | None = None
    after: Annotated[float, Field(ge=0, le=86_400)] = 0.0
    command: tuple[str, ...] = ()

    with_placeholders = ("command",)


def _amount(parse: Callable[[str, str], float]) -> BeforeValidator:
    """Return a validator that reads amounts with units."""

    def read(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return parse(value, "")
        except ConfigError as error:
            raise MistakeError(error.message, hint=error.hint) from None

    return BeforeValidator(read)


class ResourceLimits(_Table):
    """Resource limits of a component with all its descendants; 0 for no limit.

    A component that exceeds a limit is killed. Memory is resident memory; its default protects the machine from a unit
    that fills it. The default of files is below 1,024, where most systems refuse more, which each program reports in
    its own way. The other defaults are exceeded only by what would grow or run for ever.
    """

    memory: Annotated[int, _amount(parse_size), Field(ge=0)] = 2 << 30
    files: int = Field(default=1000, ge=0)
    processes: int = Field(default=256, ge=0)
    cpu: Annotated[float, _amount(parse_seconds), Field(ge=0)] = 3600.0


class Container(_Table):
    """`container`: what a component runs in; it shares this machine's network.

    `service` is one of the compose file `compose`, whose image is `image`. `engine` is podman, docker or the like, with
    `options` for its `run`.
    """

    image: Annotated[str, Field(pattern="^[^-]")]
    compose: Annotated[str, Field(min_length=1)] | None = None
    service: Annotated[str, Field(pattern="^[^-]")] | None = None
    engine: Annotated[str, Field(min_length=1)] | None = None
    options: tuple[str, ...] = ()

    with_placeholders = ("image", "compose", "options")

    @model_validator(mode="after")
    def _has_both(self) -> Self:
        if (self.compose is None) != (self.service is None):
            raise MistakeError("give both the compose file and its service, or neither of them")
        return self


class RemoteHost(_Table):
    """`ssh`: the machine on which a component's command is executed, and options of `ssh`."""

    host: Annotated[str, Field(min_length=1, pattern="^[^-]")]
    options: tuple[str, ...] = ()

    with_placeholders = ("host", "options")


def _pattern(text: str) -> str:
    """Return a regular expression unchanged; raise MistakeError for any other text."""
    try:
        re.compile(text)
    except re.error as error:
        hint = "such as 'planner|map.*'"
        raise MistakeError(f"{text!r} is not a regular expression: {error}", hint=hint) from None
    return text


def _way_to_end(value: Any) -> Any:
    """Return a way to end a component unchanged; raise MistakeError for any other value."""
    if value in ("kill", "term") or (isinstance(value, list | tuple) and value):
        return value
    hint = '"kill", "term" or a command: ["PROGRAM", "ARGUMENT", ...]'
    raise MistakeError(f"{value!r} is not a way to end a component", hint=hint)


class Component(_Table):
    """`[components.NAME]`: one process with what it starts, executed here, in a container, or on another machine.

    `command`, `env`, `cwd`, `setup`, `stop`, `teardown` and what names a container or a machine may contain {python}
    {endpoint} {segment} {trial_dir} {seed} {duration} {speed} {slot} {domain} {free_port} {free_port:NAME} {param:NAME}
    {file:PATH}, and commands that are executed while it runs (`ready.command`, `stop`) {pid} {container}. `resources`
    says how many of which of `[resources]` it needs.

    `setup` is executed before each start, to its end, and `teardown` after each end. `stop` is how it is ended: at
    once, by SIGTERM, or by a command that asks it to end. `only` is a regular expression
    for the names of those processes that belong to it, among all that the command starts; others are not started.
    `dds` gives it a ROS domain of its own and a bridge from there. One with `attach` runs already, and connects to that
    address of this machine by itself.

    `calls` are services that it calls; when it is tested alone, they are answered from its log.
    """

    command: tuple[str, ...] = ()
    container: Container | None = None
    ssh: RemoteHost | None = None
    attach: Annotated[str, Field(pattern=r"^tcp/127(\.\d{1,3}){3}:[1-9]\d{0,4}$")] | None = None
    only: Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_pattern)] | None = None
    dds: bool = False
    setup: tuple[str, ...] = ()
    teardown: tuple[str, ...] = ()
    segment: str | None = None
    env: dict[str, str] = {}
    cwd: str = "."
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    external: bool = False
    ready: Ready = Ready()
    stop: Annotated[Literal["kill", "term"] | tuple[str, ...], BeforeValidator(_way_to_end)] = "kill"
    tracebacks: Literal["fail", "ignore"] = "fail"
    limits: ResourceLimits | Literal["off"] = ResourceLimits()
    resources: dict[str, Annotated[int, Field(ge=1)]] = {}

    with_placeholders = ("command", "env", "cwd", "setup", "stop", "teardown", "ready", "container", "ssh")

    @model_validator(mode="after")
    def _can_be_started(self) -> Self:
        ways = [name for name in ("container", "ssh", "attach") if getattr(self, name) is not None]
        if len(ways) > 1:
            raise MistakeError(f"{ways[0]} and {ways[1]} exclude each other")
        if not self.command and ways in ([], ["ssh"]):
            raise MistakeError(
                "no command", hint='write command = ["PROGRAM", "ARGUMENT", ...], or container = { ... }'
            )
        if self.attach is not None and self.command:
            raise MistakeError("`attach` and `command` exclude each other: riot does not start what runs already")
        if self.attach is not None and self.stop_command:
            hint = "leave out `stop`, or use `teardown`"
            raise MistakeError("a component that runs already is not ended", hint=hint)
        if self.only is not None and ways:
            raise MistakeError("`only` is for commands that are executed here")
        if self.dds and ways not in ([], ["container"]):
            raise MistakeError(
                "`dds` is for nodes of this machine that riot starts", hint=f"leave out `dds` or `{ways[0]}`"
            )
        return self

    @property
    def stop_command(self) -> tuple[str, ...]:
        """The command that asks it to end; empty if there is none."""
        return () if isinstance(self.stop, str) else self.stop

    @property
    def is_process(self) -> bool:
        """Whether its command is executed on this machine, as a descendant of riot's."""
        return self.container is None and self.ssh is None and self.attach is None

    @property
    def files(self) -> list[str]:
        """Files that it gets a copy of with placeholders filled in, relative to the folder of riot.toml."""
        return sorted({path for text in _texts(self) for path in FILE.findall(text)})


class Parameter(_Table):
    """`[external.parameters]`: what {param:NAME} in commands stands for, and what else the outside may choose.

    With `node`, it is set in that running node of ROS 2 or component of MAVLink instead, before the inputs of each run;
    `name` is what it is called there.
    """

    nominal: bool | int | float | str
    range: tuple[float, float] | None = None
    values: tuple[bool | int | float | str, ...] = ()
    node: Annotated[str, Field(min_length=1)] | None = None
    name: Annotated[str, Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _is_told(self) -> Self:
        if self.name is not None and self.node is None:
            raise MistakeError("`name` is what a node calls it", hint='add node = "/NODE", or leave `name` out')
        if isinstance(self.nominal, bool) and not self.values and self.range is None:
            object.__setattr__(self, "values", (False, True))
        if (self.range is None) == (not self.values):
            raise MistakeError("give either range = [LEAST, MOST] or values = [...]")
        if self.values and self.nominal not in self.values:
            raise MistakeError(f"the nominal value {self.nominal!r} is not one of the values")
        if self.range is not None and (isinstance(self.nominal, str) or not self.range[0] < self.range[1]):
            raise MistakeError(f"{list(self.range)} is not a range of {self.nominal!r}")
        return self


class External(_Table):
    """`[external]`: topics that the outside world controls, what their fields may be, and fields that it does not.

    Of the topics of `timing`, messages may be late or get lost.
    """

    topics: tuple[str, ...] = ()
    ranges: dict[str, tuple[float, float]] = {}
    values: dict[str, Annotated[tuple[bool | int | float | str, ...], Field(min_length=1)]] = {}
    parameters: dict[str, Parameter] = {}
    exclude: tuple[str, ...] = ()
    timing: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _are_different(self) -> Self:
        taken: dict[tuple[str | None, str], str] = {}
        for key, one in self.in_nodes.items():
            if (other := taken.setdefault((one.node, one.name or key), key)) != key:
                raise MistakeError(
                    f"parameters {other!r} and {key!r} are the same one of {one.node!r}", place=["parameters", key]
                )
        return self

    @property
    def in_nodes(self) -> dict[str, Parameter]:
        """The parameters that running nodes take."""
        return {key: one for key, one in self.parameters.items() if one.node is not None}

    def why_not_in_commands(self, parameter: str) -> tuple[str, str] | None:
        """Return why {param:NAME} stands for nothing in a command, and a hint; None if it does."""
        if parameter not in self.parameters:
            return f"'{{param:{parameter}}}' is not described", did_you_mean(parameter, self.parameters) or ""
        if (node := self.parameters[parameter].node) is not None:
            return f"'{{param:{parameter}}}' is set in {node!r} while it runs", "use one without `node` in commands"
        return None


class Settle(_Table):
    """Times after which a unit counts as settled (no activity for `window` seconds) or as hanging (`timeout`).

    `linger` is the time that it may take to die once it has come to rest.
    """

    window: Seconds = 0.03
    linger: Seconds = 0.25
    timeout: Seconds = 10.0


class Unit(_Table):
    """`[unit.NAME]`: a component under test on its own.

    `order` says what is kept of the log's order. With "log" a message waits until the unit has taken in those of other
    topics before it; a unit with a thread for each topic may take them in any order else. "fast" does not wait. "auto"
    waits, unless that takes more than twice as long; then a failure that does not always come again is tried with the
    order kept, too.

    `malformed` payloads (cut off, fields missing or of another type) are tried last. With "group" what they break is
    told in one line, and explained for findings that are named; with "each" it is told and explained like the rest.

    Each trial has a process of its own. With `isolation` "fresh" its command is executed. With "auto" a Python program
    is forked from a process that has imported what it needs, where that makes no difference.

    `command`, `env` and `cwd` are for these trials alone, such as a build with assertions; each replaces that of the
    component. In runs of the whole system the component's own hold.
    """

    component: str | None = None
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    env: dict[str, str] | None = None
    cwd: str | None = None
    isolation: Literal["auto", "fresh"] = "auto"
    log: str | None = None
    rate: float = Field(default=0.0, ge=0)
    order: Literal["auto", "log", "fast"] = "auto"
    mined: bool = True
    settle: Settle = Settle()
    dictionaries: tuple[str, ...] = ()
    leave: tuple[str, ...] = ()
    include: tuple[str, ...] = ()
    malformed: Literal["group", "each", "never"] = "group"

    @model_validator(mode="before")
    @classmethod
    def _has_no_shared_process(cls, table: Any) -> Any:
        if isinstance(table, dict) and (table.get("isolation") == "persistent" or "reset" in table):
            hint = 'leave out `reset`, and `isolation` or write "auto", which saves most of a Python program\'s start'
            place = ["reset" if "reset" in table else "isolation"]
            raise MistakeError("trials of a unit no longer share a process", hint=hint, place=place)
        return table


class SystemFile(_Table):
    """A whole riot.toml."""

    system: System = System()
    components: dict[str, Component] = Field(min_length=1)
    external: External = External()
    monitors: tuple[dict[str, Any], ...] = ()
    unit: dict[str, Unit] = {}
    resources: dict[Annotated[str, Field(pattern=r"^[\w-]+$")], Annotated[int, Field(ge=1, le=1000)]] = {}
    router: RouterSettings | None = None
    path: Path = Path("riot.toml")
    _invariants: tuple[Invariant, ...] = ()

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        for place, message, hint in self._mistakes():
            raise MistakeError(message, hint=hint, place=place.split("."))
        return self

    def _mistakes(self) -> Iterator[tuple[str, str, str]]:
        """Yield the mistakes that several tables make together: place, what is wrong, what to do."""
        taken: dict[str, str] = {}
        for name, component in self.components.items():
            if component.attach is not None and (other := taken.setdefault(component.attach, name)) != name:
                why = f"{component.attach!r} is the address of {other!r}, too"
                yield f"components.{name}.attach", why, "each needs an address of its own"
        for name, component in self.components.items():
            if component.segment is not None and component.segment not in self.system.segments:
                yield _unknown(f"components.{name}.segment", component.segment, self.system.segments)
            yield from self._placeholder_mistakes(component, f"components.{name}")
            for resource, count in component.resources.items():
                place = f"components.{name}.resources"
                if resource not in self.resources:
                    yield _unknown(place, resource, self.resources)
                elif count > self.resources[resource]:
                    there = f"[resources] has {self.resources[resource]} of {resource!r}"
                    yield place, f"{count} are more than there are", there
        if self.system.clock is not None:
            if self.system.reset is not None:
                hint = "write clock = { reset = ... }"
                yield "system.reset", "runs in virtual time have a reset of their own", hint
            if any(component.external for component in self.components.values()):
                hint = "let the nominal log drive the system"
                yield "system.clock", "external components have a time of their own", hint
            for name in ("trial_run", "perturbed_run"):
                if getattr(self.system, name).speed != 1.0:
                    why = "with [system.clock], runs are as fast as they can"
                    yield f"system.{name}.speed", why, "leave `speed` out"
        for name, unit in self.unit.items():
            part = self.component_of(name)
            if part not in self.components:
                yield _unknown(f"unit.{name}.component" if unit.component else f"unit.{name}", part, self.components)
                continue
            if self.components[part].ssh is not None:
                why = "a unit runs on this machine, where riot can see what its processes do"
                yield f"unit.{name}", why, "leave `ssh` out, or test another component"
            if self.components[part].attach is not None and unit.command is not None:
                hint = "leave out `command`, or `attach`"
                yield f"unit.{name}.command", "a component that runs already has no command", hint
            yield from self._placeholder_mistakes(self.component_alone(name), f"unit.{name}")

    def _placeholder_mistakes(self, component: Component, place: str) -> Iterator[tuple[str, str, str]]:
        for key in component.with_placeholders:
            for text in _texts(getattr(component, key)):
                for parameter in PARAMETER.findall(text):
                    if why := self.external.why_not_in_commands(parameter):
                        yield f"{place}.{key}", *why
                if found := _misspelt(text):
                    yield f"{place}.{key}", *found

    def texts_of(self, component: Component) -> list[str]:
        """Return all texts that may have placeholders: those of a component, and of the files that it gets copies of.

        Raises:
            ConfigError: A file cannot be read.
        """
        return [*_texts(component), *map(self.text_of, component.files)]

    def text_of(self, name: str) -> str:
        """Return the text of a file in which placeholders are filled in; raises ConfigError if it cannot be read."""
        try:
            return (self.root / name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            hint = "it is a text whose placeholders are filled in; paths start from the folder of riot.toml"
            raise ConfigError(f"cannot read {name!r}: {error}", where=f"{self.path}: {{file:...}}", hint=hint) from None

    @property
    def invariants(self) -> tuple[Invariant, ...]:
        """The monitors of `[[monitors]]`, ready to judge; empty unless `load_system` has read the file."""
        return self._invariants

    @property
    def monitor_files(self) -> list[str]:
        """Files of monitors that `[[monitors]]` names, relative to the folder of riot.toml."""
        files = (str(table.get("kind", "")).partition(":")[0] for table in self.monitors)
        return sorted({file for file in files if file.endswith(".py")})

    @property
    def root(self) -> Path:
        """The folder that relative paths start from."""
        return self.path.parent

    def segment_of(self, component: Component) -> str:
        """Return the segment that a component connects to."""
        return component.segment or self.system.segments[0]

    def component_of(self, unit: str) -> str:
        """Return the name of a unit's component."""
        return self.unit[unit].component or unit

    def component_alone(self, unit: str) -> Component:
        """Return the component of a unit as it is when the unit is tested alone: with the unit's own command."""
        described = self.unit[unit]
        component = self.components[self.component_of(unit)]
        own = {key: getattr(described, key) for key in ("command", "env", "cwd")}
        given = {key: value for key, value in own.items() if value is not None}
        return component.model_copy(update=given) if given else component

    def alone(self, unit: str) -> SystemFile:
        """Return the file as it holds for trials of a unit alone."""
        name, component = self.component_of(unit), self.component_alone(unit)
        if component is self.components[name]:
            return self
        return self.model_copy(update={"components": {**self.components, name: component}})

    @property
    def programs(self) -> list[Component]:
        """All components as they are started: in runs of the whole system, and as units alone."""
        return [*self.components.values(), *map(self.component_alone, self.unit)]

    def shared_segments(self) -> set[str]:
        """Return the segments that external components share with the system."""
        inside, outside = (
            {self.segment_of(one) for one in self.components.values() if one.external is way} for way in (False, True)
        )
        return inside & outside

    def check_outside_apart(self) -> None:
        """Check that what external components publish passes riot on its way to the system.

        Raises:
            ConfigError: They share a segment with the system.
        """
        if shared := self.shared_segments():
            raise ConfigError(
                f"external components share segment {min(shared)!r} with the system, so nothing can be intercepted",
                where=f"{self.path}: [components]",
                hint="give external components a `segment` of their own",
            )

    def isolation_of(self, component: str) -> str:
        """Return how processes of a component are started: "fresh" if one of its units says so, else "auto"."""
        units = [unit for name, unit in self.unit.items() if self.component_of(name) == component]
        return "fresh" if any(unit.isolation == "fresh" for unit in units) else "auto"

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
            add = f"add a table [unit.{name}]" if name in self.components else None
            raise ConfigError(f"no unit {name!r}", where=str(self.path), hint=add or did_you_mean(name, self.unit))
        return name


def _misspelt(text: str) -> tuple[str, str] | None:
    """Return what is wrong with a text's placeholders, and a hint; other words in braces are the program's own."""
    for found in _PLACEHOLDER.finditer(text):
        word, more = found.groups()
        if word == "free_port" and more is not None and not FREE_PORT.fullmatch(found[0]):
            return f"{found[0]!r} is not a placeholder", "the name has letters, digits and _, 40 at most"
        # Near are `{speeed}` and `{enpoint}`, but not `{feed}` or `{port}`.
        near = [] if word in _PLACEHOLDERS else get_close_matches(word, _PLACEHOLDERS, n=1, cutoff=0.8)
        if near:
            return f"{found[0]!r} is not a placeholder", f"did you mean {{{near[0]}}}? If not, write it {{{found[0]}}}"
    return None


def _unknown(place: str, word: str, known: Any) -> tuple[str, str, str]:
    return place, f"{word!r} is not described", did_you_mean(word, known) or ""


def read_system(path: Path) -> SystemFile:
    """Read and check a system file, whoever wrote it: nothing that it names is loaded, so its monitors cannot judge.

    Raises:
        ConfigError: Missing file, TOML syntax error, unknown key or bad value; with place and suggestion.
    """
    return _read(path)[0]


def load_system(path: Path) -> SystemFile:
    """Read and check a user's own system file: its monitors' files are executed; raises as `read_system`."""
    file, text = _read(path)
    file._invariants = tuple(
        build_monitor(table, where=partial(_place, path, text, str(number)), root=file.root)
        for number, table in enumerate(file.monitors)
    )
    return file


def _read(path: Path) -> tuple[SystemFile, str]:
    document, text = read_toml(path)
    if "path" in document:
        raise ConfigError("unknown key 'path'", where=f"{path}:{line_of(text, ['path'])}")
    try:
        return SystemFile.model_validate({**document, "path": path.resolve()}), text
    except ValidationError as error:
        raise explained(error, path, text, _known_keys) from None


def _place(path: Path, text: str, number: str, key: str) -> str:
    return place_of(path, text, ["monitors", number, key] if key else ["monitors", number])


def _known_keys(place: list[str]) -> list[str]:
    if place[:1] == ["router"]:
        return router_keys(place)
    tables: dict[str, type[BaseModel]] = {"": SystemFile, **_tables(SystemFile)}
    for name in reversed(place or [""]):
        if name in tables:
            return [key for key in tables[name].model_fields if key != "path"]
    return []


def _tables(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """Return the models of all tables below that of a model, by the name of the field that holds them."""
    found: dict[str, type[BaseModel]] = {}
    for name, field in model.model_fields.items():
        annotations = [field.annotation]
        for each in annotations:  # grows by the arguments of unions, mappings and the like
            annotations += get_args(each)
            if inspect.isclass(each) and issubclass(each, BaseModel):
                found |= {name: each, **_tables(each)}
    return found
