"""A machine that is a pure function: a panel, a governor, and a drive that fails on steps smaller than one."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from riot_bus.chain.base.workspace import StepRun, Workspace
from riot_bus.events import RunEvent
from riot_bus.findings.permeability import EdgeRecord, PermeabilityRecord
from riot_bus.findings.records import (
    CertificateRecord,
    FieldRecord,
    FieldsRecord,
    FindingRecord,
    MinimalRecord,
    ProportionRecord,
    RuleRecord,
)
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.inject.apply import inject_log
from riot_bus.log.writer import LogWriter
from riot_bus.system.system_file import RunPace
from riot_bus.trial.baseline import UNKNOWN, Baseline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Series, TestCase, Verdict, Violation

SYSTEM = """
[system]
name = "machine"
segments = ["shop", "inside"]

[components.panel]
command = ["panel"]
segment = "shop"
external = true
outputs = ["panel"]

[components.governor]
command = ["governor"]
segment = "inside"
inputs = ["panel"]
outputs = ["command"]

[components.drive]
command = ["drive"]
segment = "inside"
inputs = ["command"]

[external]
topics = ["panel"]

[external.ranges]
"panel:knob" = [-1000, 1000]
"panel:lever" = [0, 1]

[unit.drive]
"""
LOGGED = SYSTEM.replace(
    """[components.panel]
command = ["panel"]
segment = "shop"
external = true
outputs = ["panel"]

""",
    "",
).replace('name = "machine"', 'name = "machine"\nnominal = "nominal.mcap"')
"""The same machine, of whose panel there is nothing but a log."""
MODE, SPEED = "command:mode", "command:speed"
HANG = Violation("hang", "drive", "hang of drive", "still busy")
OTHER = Violation("crash", "drive", "crash in drive: x.py:1 in f", "ValueError: 1")
COUNT = 60


def said(message: Message) -> Any:
    return json.loads(message.payload)


def panel(seed: int) -> list[Message]:
    """What the panel publishes: 20 readings a second, all of them harmless."""
    noise = random.Random(seed)
    return [
        Message(
            10**18 + number * 50_000_000,
            "panel",
            json.dumps(
                {"knob": 60 + noise.uniform(-20, 20), "lever": noise.uniform(0.55, 1.0), "heat": noise.gauss(40, 2)}
            ).encode(),
            sequence=number,
        )
        for number in range(COUNT)
    ]


def commands(readings: Sequence[Message]) -> list[Message]:
    """What the governor makes of the readings; it ignores what is none."""
    found = []
    for reading in readings:
        try:
            values = said(reading)
            mode = "step" if values["lever"] > 0.5 else "hold"
            payload = json.dumps({"mode": mode, "speed": values["knob"] / 20, "note": "panel"}).encode()
        except (ValueError, KeyError, TypeError):
            continue
        found.append(Message(reading.time + 1000, "command", payload, sequence=reading.sequence))
    return found


def hangs(messages: Sequence[Message]) -> int | None:
    """Return the first command on which the drive hangs."""
    for place, message in enumerate(messages):
        try:
            values = said(message)
        except ValueError:  # the drive ignores what is cut off
            continue
        if values.get("mode") == "step" and isinstance(values.get("speed"), (int, float)) and values["speed"] < 1:
            return place
    return None


def never_hangs(messages: Sequence[Message]) -> int | None:
    return None


def always(messages: Sequence[Message]) -> int | None:
    return 0


def never(case: TestCase) -> bool:
    return False


def share(case: TestCase, seed: int = 0) -> float:
    """Return a number from 0 to 1 that depends on the case alone, by which answers can be made wrong at random."""
    return int(hashlib.sha256(f"{seed}{case.digest()}".encode()).hexdigest()[:8], 16) / 2**32


def sometimes(rate: float, false: float = 0.0, seed: int = 0) -> Callable[[TestCase], bool]:
    """Return which answers are wrong, when the drive hangs at this rate, and falsely at the other one."""

    def wrong(case: TestCase) -> bool:
        drawn = share(case, seed)
        return drawn >= rate if hangs(case.messages) is not None else drawn < false

    return wrong


@dataclass
class PureRunner:
    """A runner that is a function."""

    answer: Callable[[TestCase], Outcome]
    parallelism: int = 4

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        return [self.answer(case) for case in cases]


@dataclass
class Machine:
    """Gives runners that are functions.

    Attributes:
        folder: Where failing runs of the system leave their logs.
        fails: Where the drive fails on what it gets; None if it does not.
        wrong: Whether a trial of the drive is answered wrongly.
        other: Whether a trial that fails does so in another way.
        broken: Whether a trial cannot be carried out.
        system_fails: As `fails`, in runs of the whole system.
        system_wrong: As `wrong`, likewise.
        governor: What the governor makes of what the panel says.
        known: What the drive does in nominal runs of the whole system.
        alone: What it does in nominal trials of its own.
        parameters: Those of the latest run of the whole system that were not nominal.
        judged: The units that runs of the whole system judge, in the order in which their runners were asked for.
    """

    folder: Path
    fails: Callable[[Sequence[Message]], int | None] = hangs
    wrong: Callable[[TestCase], bool] = never
    other: Callable[[TestCase], bool] = never
    broken: Callable[[TestCase], bool] = never
    system_fails: Callable[[Sequence[Message]], int | None] = hangs
    system_wrong: Callable[[TestCase], bool] = never
    governor: Callable[[Sequence[Message]], list[Message]] = commands
    known: Baseline = field(default_factory=lambda: Baseline(trials=4))
    alone: Baseline = UNKNOWN
    parameters: dict[str | None, Any] = field(default_factory=dict)
    executed: list[TestCase] = field(default_factory=list)
    judged: list[str] = field(default_factory=list)
    closed: bool = False

    def unit(self, unit: str, log: object) -> PureRunner:
        assert unit == "drive"
        return PureRunner(self.play)

    def baseline(self, unit: str, log: object) -> Baseline:
        return self.alone

    def in_system(self, unit: str, log: object, pace: RunPace, driving: Sequence[Message]) -> Baseline:
        return self.known

    def keep_evidence(
        self, unit: str, case: TestCase, signature: str, folder: Path, *, in_system: Baseline | None = None
    ) -> bool:
        return False

    def play(self, case: TestCase) -> Outcome:
        messages, touched = inject_log(case.messages, case.injections, registry=TypeRegistry(), seed=case.seed)
        place = self.fails((*messages, *(() if case.unprobed else self.alone.follows)))
        played = len(messages) if place is None else place + 1
        modified = sum(index < played for index, _, _ in touched)
        return self.outcome(
            case, (place is not None) != self.wrong(case), statistics={"played": played, "modified": modified}
        )

    def system(
        self,
        pace: RunPace,
        *,
        observe: Sequence[str] = (),
        record: Path | None = None,
        judged: tuple[str, Baseline] | None = None,
        timed: bool = True,
    ) -> PureRunner:
        self.judged += [judged[0]] if judged else []
        return PureRunner(lambda case: self.drive(case, observe, record))

    def drive(self, case: TestCase, observe: Sequence[str], record: Path | None) -> Outcome:
        given = case.messages or panel(case.seed)
        injections = [each for each in case.injections if each.topic != PARAMETERS]
        reached: list[list[int]] = []
        readings, _ = inject_log(given, injections, registry=TypeRegistry(), seed=case.seed, reached=reached)
        told = {} if case.messages else {"statistics": {"delivered": [len(each) for each in reached]}}
        self.parameters = {each.field: each.value for each in case.injections if each.topic == PARAMETERS}
        made = self.governor(readings)
        if record is not None:
            with LogWriter(record, metadata={"seed": str(case.seed)}) as writer:
                for message in sorted([*readings, *made], key=lambda message: message.time):
                    writer.write(message)
        observed = {name: series(name, [*readings, *made], case.seed) for name in observe}
        failed = (self.system_fails(made) is not None) != self.system_wrong(case)
        found = self.outcome(case, failed, observed=observed, **told)
        if found.verdict is not Verdict.FAIL or case.messages:
            return found
        path = self.folder / f"external-{len(self.executed)}.mcap"
        with LogWriter(path) as writer:
            for reading in readings:
                writer.write(reading)
        return replace(found, log=str(path))

    def outcome(self, case: TestCase, failed: bool, **more: Any) -> Outcome:
        self.executed.append(case)
        if self.broken(case):
            return Outcome(Verdict.ERROR, detail="no port")
        if failed:
            return Outcome(Verdict.FAIL, (OTHER if self.other(case) else HANG,), **more)
        return Outcome(Verdict.PASS, **more)

    def close(self) -> None:
        self.closed = True


def series(name: str, messages: Sequence[Message], seed: int) -> Series:
    """Return a field over time, as it is seen: numbers with some noise."""
    noise = random.Random(seed)
    topic, _, path = name.partition(":")
    chosen = [message for message in messages if message.key == topic]
    times = tuple((message.time - 10**18) / 1e9 for message in chosen)
    values = [said(message)[path] for message in chosen] if path else []
    return Series(times, tuple(value if isinstance(value, str) else value + noise.gauss(0, 0.1) for value in values))


@dataclass
class Bench:
    """A workspace over a machine, and all that was told of it."""

    workspace: Workspace
    machine: Machine
    events: list[RunEvent]

    @property
    def folder(self) -> Path:
        """The finding."""
        return self.workspace.findings / "hang-drive-1"

    def run(self, name: str = "step") -> StepRun:
        return StepRun(self.workspace, name)

    def told(self, kind: type[RunEvent]) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]


def bench(folder: Path, system: str = SYSTEM, **machine: Any) -> Bench:
    """Return a workspace in a folder whose machine is made with some options."""
    (folder / "riot.toml").write_text(system)
    events: list[RunEvent] = []
    made = Machine(folder, **machine)
    workspace = Workspace(folder / "riot.toml", folder / "out", listeners=[events.append], runners=made)
    return Bench(workspace, made, events)


def command(mode: object, speed: object, number: int = 0) -> Message:
    payload = json.dumps({"mode": mode, "speed": speed, "note": "panel"}).encode()
    return Message(10**18 + number * 50_000_000, "command", payload, sequence=number)


def write_finding(
    one: Bench, messages: Sequence[Message], originals: dict[int, Message], name: str = "failure"
) -> None:
    """Write a finding with its failing (or minimal) log."""
    from riot_bus.chain.base.logs import FailingLog

    one.folder.mkdir(parents=True, exist_ok=True)
    FindingRecord(
        id="hang-drive-1", system="machine", system_file=str(one.workspace.context.file.path), unit="drive",
        component="drive", monitor="hang", signature=HANG.signature, messages=len(messages), modified=len(originals),
    ).save(one.folder)  # fmt: skip
    FailingLog(tuple(messages), originals).save(one.folder / f"{name}.mcap", context=one.workspace.context, metadata={})


def write_minimal(one: Bench, speed: float = -5.0) -> None:
    """Write a finding whose minimal log is one command, the speed of which was injected."""
    write_finding(one, [command("step", speed)], {0: command("step", 3.0)}, "minimal")
    MinimalRecord(before=COUNT, kept=(7,), topics=("command",), one_minimal=True).save(one.folder)


def rated(one: Bench, failed: int, total: int) -> None:
    """Write into the finding that so many of so many fresh trials failed, and no nominal one."""
    rate = ProportionRecord(value=failed / total, low=0, high=1, count=failed, total=total)
    none = ProportionRecord(value=0, low=0, high=1, count=0, total=4)
    FindingRecord.load(one.folder).model_copy(update={"rate": rate, "nominal": none}).save(one.folder)


def write_nominal(folder: Path) -> None:
    """Write the log that `LOGGED` names."""
    readings = panel(0)
    with LogWriter(folder / "nominal.mcap") as writer:
        for pair in zip(readings, commands(readings), strict=True):
            for message in pair:
                writer.write(message)


def write_fields(one: Bench, *names: str) -> None:
    """Write the relevant fields of a minimal log."""
    values: dict[str, tuple[Any, Any]] = {SPEED: (-5.0, 3.0), MODE: ("step", "hold")}
    fields = []
    for name in names:
        failing, passing = values[name]
        certificate = CertificateRecord(
            failing=failing, passing=passing, failing_log="", passing_log="", confirmed_failing=3, confirmed_passing=3,
            repeats=3,
        )  # fmt: skip
        kind = "exceptional" if name == SPEED else "nominal"
        fields.append(FieldRecord(name=name, kind=kind, type="float", failing=failing, certificate=certificate))
    FieldsRecord(fields=tuple(fields), considered=tuple(names), bound=0.2, straight=12).save(one.folder)


def write_permeability(one: Bench, *strengths: tuple[str, float]) -> None:
    """Write which external fields reach the speed, and how strongly; not at all below a half."""
    edges = tuple(
        EdgeRecord(
            external=name,
            internal=SPEED,
            permeable=strength >= 0.5,
            strength=strength,
            low=0,
            high=1,
            lag_s=0,
            p_value=0,
        )
        for name, strength in strengths
    )
    PermeabilityRecord(edges=edges, runs=8).save(one.folder)


def write_rule(one: Bench) -> None:
    """Write the rule of the drive's failure."""
    slow = Literal(Feature("raw", (SPEED,)), "<", 1)
    rule = Rule(((Literal(Feature("raw", (MODE,)), "==", "step"), slow),))
    sure = ProportionRecord(value=1.0, low=0.9, high=1.0, count=30, total=30)
    RuleRecord(
        text=rule.text(), rule=rule.to_dict(), precision=sure, recall=sure, checks=60,
        balanced_accuracy=1.0, scale={SPEED: 1.0}, types={MODE: "string", SPEED: "float64"},
    ).save(one.folder)  # fmt: skip
