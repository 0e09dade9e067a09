"""A guard made from a finding's rule, and tried on the finding's logs before it protects the unit."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from riot_bus.chain.base.logs import FailingLog, inputs_of, read_messages
from riot_bus.chain.base.systems import described, system_of
from riot_bus.chain.base.workspace import NOMINAL
from riot_bus.findings.records import FindingRecord, RuleRecord, shortest_log
from riot_bus.interceptors.guard import RuleGuard
from riot_bus.pipeline.runner import Pipeline
from riot_bus.system.system_file import SystemFile
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.toml_text import toml_string


@dataclass(frozen=True, slots=True)
class GuardTrial:
    """Effect of a guard on a log."""

    log: str
    messages: int
    met: int
    done: dict[str, int]
    unread: int

    def text(self) -> str:
        """Return the effect in one line."""
        done = ", ".join(f"{count} {what}" for what, count in self.done.items()) or "all pass as they are"
        unread = f"; {self.unread} pass that lack a field of the rule" if self.unread else ""
        return f"{self.log}: the rule holds for {self.met} of {counted(self.messages, 'message')}: {done}{unread}"


@dataclass(frozen=True, slots=True)
class GuardPlan:
    """A guard for riot.toml and for the command line, and its effect on the finding's logs.

    Attributes:
        bypassed: Components that publish a topic of the rule on the unit's own segment, where nothing is intercepted.
    """

    rule: str
    toml: str
    command: str
    trials: tuple[GuardTrial, ...]
    bypassed: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Return what people should know before they use it."""
        told = [f"it fails when {self.rule}", *(each.text() for each in self.trials)]
        if self.bypassed:
            names = ", ".join(self.bypassed)
            told.append(f"nothing is intercepted between the unit and {names} on its segment: give it one of its own")
        return [*told, f"without riot.toml: {self.command}"]


def plan_guard(folder: Path, *, action: Literal["drop", "clamp", "hold", "report"] = "drop") -> GuardPlan:
    """Try a guard on the logs of a finding, and say how to put it in front of the unit; nothing is started.

    Raises:
        ConfigError: There is no rule, or a guard cannot carry it out.
    """
    record, finding, path = RuleRecord.load(folder), FindingRecord.load(folder), folder / RuleRecord.FILE
    try:
        path_shown = own = system_of(finding.system_file, folder)
    except ConfigError:  # no file of the user's own: the guard is for one that is yet to be written
        path_shown, own = Path("riot.toml"), None
    file, registry = described(folder, named=own)
    failing = shortest_log(folder)
    logs: list[tuple[str, Sequence[Message]]] = [
        ("nominal log", _nominal(file, registry, finding.unit, folder.parent.parent / NOMINAL)),
        (failing.name, FailingLog.load(failing, registry=registry).messages),
    ]
    trials = tuple(_tried(name, log, RuleGuard(path, action), registry) for name, log in logs if log)
    root = path_shown.resolve().parent
    table = {"use": "guard", "rule": os.path.relpath(path.resolve(), root), "action": action}
    toml = "\n".join(["[[router.interceptors]]", *(f"{key} = {toml_string(value)}" for key, value in table.items())])
    option = f"guard rule={toml_string(str(path))} action={action}"
    command = f"riot router --system {shlex.quote(str(path_shown))} --interceptor {shlex.quote(option)}"
    topics = RuleGuard(path, action).topics
    keys = {one.key for _, log in logs for one in log if registry.topic(one.key) in topics}
    bypassed = _bypassed(file, registry, finding.component, keys) if file is not None else ()
    return GuardPlan(record.text, toml, command, trials, bypassed)


def _nominal(file: SystemFile | None, registry: TypeRegistry, unit: str, recorded: Path) -> Sequence[Message]:
    """Return the unit's inputs in the nominal log; none if there is no such log yet, or the unit is not described."""
    if file is None or unit not in file.unit:
        return ()
    named = file.unit[unit].log or file.system.nominal
    path = file.root / named if named else recorded
    if not path.is_file():
        return ()
    return inputs_of(unit, read_messages(path, registry=registry), file=file, registry=registry, path=path)


def _bypassed(file: SystemFile, registry: TypeRegistry, component: str, keys: set[str]) -> tuple[str, ...]:
    """Return the components that publish some of these keys on the segment of a component."""
    components, matches = file.components, registry.matches
    own = components[component].segment if component in components else None
    return tuple(
        name
        for name, each in components.items()
        if name != component and each.segment == own and any(matches(out, key) for out in each.outputs for key in keys)
    )


def _tried(name: str, log: Sequence[Message], guard: RuleGuard, registry: TypeRegistry) -> GuardTrial:
    """Feed a log to a guard and return what it did."""
    pipeline = Pipeline([guard], registry=registry)
    for message in log:
        pipeline.feed(message)
    unread = sum(each.count for each in pipeline.errors.values())
    return GuardTrial(name, len(log), guard.met.total(), dict(guard.done), unread)
