"""Cases: a report, its program, its truth, and ways to run both without riot."""

from __future__ import annotations

import importlib.util
import json
import math
import random
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from riot_bus.log.writer import LogWriter
from riot_bus.trial.baseline import probe_of
from riot_bus.vocabulary.message import Message
from tests.interop import of_case, provide

HERE = Path(__file__).resolve().parent
CASES = HERE / "cases"
SERVE = HERE / "serve.py"
FIRST_NS, STEP_NS = 10**18, 10**8

Input = tuple[float, str, Any]
"""Seconds since the start, topic, and the fields of a message."""


class CaseFile(BaseModel):
    """What case.toml says; see README.md beside this file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    report: str
    title: str
    kind: str
    packages: tuple[str, ...]
    twin: tuple[str, ...] = ()
    symptom: Literal["crash", "hang", "silent", "nan", "wrong", "none"]
    outputs: tuple[str, ...]
    riot: str = ""
    chance: float = 1.0


@dataclass(frozen=True, slots=True)
class Run:
    """What became of a log: `passed`, `raised`, `hung` or `signal N`, with the outputs until then."""

    end: str
    outputs: Sequence[tuple[str, Any]]
    handled: int
    error: str = ""
    place: str = ""


class Case:
    """A folder with `case.toml`, `node.py` and `truth.py`."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.name = folder, folder.name
        self.file = CaseFile.model_validate(tomllib.loads((folder / "case.toml").read_text(encoding="utf-8")))

    @cached_property
    def truth(self) -> Any:
        """The module `truth.py`, whose functions know nothing of the program."""
        spec = importlib.util.spec_from_file_location(f"truth_{self.name}", self.folder / "truth.py")
        assert spec is not None
        assert spec.loader is not None
        found = importlib.util.module_from_spec(spec)
        sys.modules.setdefault("changes", importlib.import_module("benchmarks.real_faults.changes"))
        spec.loader.exec_module(found)
        return found

    @cached_property
    def nominal(self) -> list[Input]:
        """The nominal inputs."""
        return list(self.truth.nominal())

    @cached_property
    def forms(self) -> dict[str, list[Any]]:
        """The forms of nominal messages by topic, without what differs between messages of one form."""
        found: dict[str, list[Any]] = {}
        for _, topic, fields in self.nominal:
            forms = found.setdefault(topic, [])
            if (form := form_of(fields)) not in forms:
                forms.append(form)
        return found

    @property
    def inputs(self) -> list[str]:
        """The topics of the inputs."""
        return sorted({topic for _, topic, _ in self.nominal})

    def fails(self, log: Sequence[Input]) -> bool:
        """Return whether the report's fault occurs with these inputs, by the truth alone."""
        return self.has_truth and self.truth.fails(list(log)) is not None

    @property
    def has_truth(self) -> bool:
        """Whether there is a report; controls have none."""
        return self.file.symptom != "none"

    @cached_property
    def probe(self) -> tuple[Message, ...]:
        """The nominal messages that riot plays after a trial; none if nominal trials would fail on these."""
        nominal = messages_of(self.nominal)
        probe = probe_of(nominal)
        return () if self.verdict(_after(nominal, probe))[0] else probe

    def followed(self, messages: Sequence[Message]) -> list[Message]:
        """Return messages and the nominal ones that follow them in a trial, to see whether the node still works."""
        return _after(messages, self.probe)

    def verdict(self, messages: Sequence[Message]) -> tuple[Literal["known", "own", ""], int]:
        """Return what occurs first, and at which message.

        Returns:
            `known`: the report's fault; `own`: a payload of another form, which ends a node that takes its messages for
            what they are; empty if nothing does. Then the number of messages, else the index of the message.
        """
        log: list[Input] = []
        for seconds, message in zip(seconds_of(messages), messages, strict=True):
            try:
                fields = json.loads(message.payload)
            except ValueError:
                break
            if message.kind != "put" or not self.has_form(message.key, fields):
                break
            log.append((seconds, message.key, fields))
        if self.has_truth and (index := self.truth.fails(log)) is not None:
            return "known", index
        return "own" if len(log) < len(messages) else "", len(log)

    def python(self, *, twin: bool = False) -> Path:
        """Return the interpreter of the program, or of the twin, installed if necessary; raises RuntimeError."""
        environment = of_case(self.folder, twin=twin)
        if problem := provide(environment):
            raise RuntimeError(f"{self.name}: {problem}")
        return environment.entry

    def command(self, endpoint: str, *, twin: bool = False) -> list[str]:
        """Return the command of the node on the bus; `-` for a node without one."""
        checked = ["--checked"] if twin and not self.file.twin else []
        return [str(self.python(twin=twin)), str(SERVE), str(self.folder), endpoint, *checked]

    def shows(self, log: Sequence[Input], run: Run) -> bool:
        """Return whether a run shows the symptom of the report."""
        match self.file.symptom:
            case "crash":
                return run.end == "raised" or run.end.startswith("signal")
            case "hang":
                return run.end == "hung"
            case "none":
                return run.end != "passed" or not _finite(run)
            case "nan":
                return not _finite(run)
            case _:
                return bool(self.truth.shows(list(log), run.outputs))

    def has_form(self, topic: str, fields: Any) -> bool:
        """Return whether a message has a form of nominal ones."""
        return any(has_form(fields, form) for form in self.forms[topic])

    @contextmanager
    def program(self, *, twin: bool = False) -> Iterator[Callable[[Sequence[Input]], Run]]:
        """Yield a function that runs a log without riot, with a new process each time."""
        with subprocess.Popen(
            self.command("-", twin=twin),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=self.folder,
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            feed, answers = process.stdin, process.stdout

            def run(log: Sequence[Input]) -> Run:
                feed.write(json.dumps(log) + "\n")
                feed.flush()
                if line := answers.readline():
                    return Run(**json.loads(line))
                raise RuntimeError(f"{self.name}: the node has ended; try it: {' '.join(self.command('-', twin=twin))}")

            yield run
            feed.close()

    def run(self, logs: Sequence[Sequence[Input]], *, twin: bool = False) -> Iterator[Run]:
        """Run logs without riot, each with a new process."""
        with self.program(twin=twin) as run:
            yield from map(run, logs)

    def shown(
        self, logs: Sequence[tuple[bool, Sequence[Input], str]], *, twin: bool = False
    ) -> Iterator[tuple[bool, Run]]:
        """Yield whether the symptom is shown, and the run; where a fault needs luck, what should fail is repeated."""
        tries = 1 if self.file.chance == 1 else math.ceil(math.log(0.001) / math.log1p(-self.file.chance))
        for fails, log, _ in logs:
            for run in self.run([log] * (tries if fails else 1), twin=twin):
                if self.shows(log, run):
                    break
            yield self.shows(log, run), run

    def draws(self, count: int, seed: int) -> Iterator[list[Input]]:
        """Yield inputs near the limits of the truth and far away, as many failing as not as far as possible."""
        draw: Callable[[random.Random], list[Input]] = self.truth.draw
        source = random.Random(seed)
        left = {True: (count + 1) // 2, False: count // 2}
        for _ in range(50 * count):
            log = draw(source)
            fails = self.fails(log)
            if left[fails]:
                left[fails] -= 1
                yield log
            if not any(left.values()):
                return

    def write(self, folder: Path, command: Sequence[str]) -> Path:
        """Write riot.toml and the nominal log as a user would have them; return the path of the former."""
        folder.mkdir(parents=True, exist_ok=True)
        with LogWriter(folder / "nominal.mcap") as log:
            for message in messages_of(self.nominal):
                log.write(message)
        path = folder / "riot.toml"
        path.write_text(
            f'[system]\nname = "{self.name}"\nnominal = "nominal.mcap"\n\n'
            f"[components.node]\ncommand = {json.dumps(command)}\n"
            f"inputs = {json.dumps(self.inputs)}\noutputs = {json.dumps(self.file.outputs)}\n\n"
            f"[unit.node]\n{self.file.riot}"
        )
        return path


def _after(messages: Sequence[Message], probe: Sequence[Message]) -> list[Message]:
    last = messages[-1].time if messages else FIRST_NS
    return [*messages, *(each.with_(time=last + each.time - probe[0].time + STEP_NS) for each in probe)]


def messages_of(log: Sequence[Input]) -> list[Message]:
    """Return inputs as messages."""
    return [
        Message(FIRST_NS + round(seconds * 1e9), topic, json.dumps(fields).encode(), encoding="application/json")
        for seconds, topic, fields in log
    ]


def seconds_of(messages: Sequence[Message]) -> list[float]:
    """Return the time of each message since the first one."""
    return [(each.time - messages[0].time) / 1e9 for each in messages]


def inputs_of(messages: Sequence[Message]) -> list[Input]:
    """Return messages as inputs; raises ValueError for a payload that is not JSON."""
    return [
        (time, each.key, json.loads(each.payload)) for time, each in zip(seconds_of(messages), messages, strict=True)
    ]


def _finite(run: Run) -> bool:
    return all(math.isfinite(each) for _, fields in run.outputs for each in numbers(fields))


def numbers(value: Any) -> Iterator[float]:
    """Yield all numbers in a JSON value."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for each in value:
            yield from numbers(each)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


def form_of(value: Any) -> Any:
    """Return a value without what differs between messages of one form: numbers, texts, and lengths of arrays."""
    if isinstance(value, dict):
        return {key: form_of(each) for key, each in value.items()}
    if isinstance(value, list):
        return [form_of(value[0])] if value else []
    return 0 if isinstance(value, int | float) and not isinstance(value, bool) else type(value)()


def has_form(value: Any, form: Any) -> bool:
    """Return whether a value has the keys and types of a form."""
    if isinstance(form, dict):
        same = isinstance(value, dict) and value.keys() == form.keys()
        return same and all(has_form(value[key], form[key]) for key in form)
    if isinstance(form, list):
        return isinstance(value, list) and all(has_form(each, form[0]) for each in value if form)
    if isinstance(form, bool) or not isinstance(form, int):
        return type(value) is type(form)
    return isinstance(value, int | float) and not isinstance(value, bool)


def all_cases() -> list[Case]:
    """Return all cases, by name."""
    return [Case(path.parent) for path in sorted(CASES.glob("*/case.toml"))]
