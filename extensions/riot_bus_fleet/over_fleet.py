"""`riot fleet run`: replay of a test case over many logs, to see on which it still makes the software fail."""

from __future__ import annotations

import hashlib
import json
import logging
import threading
import time
from dataclasses import asdict, dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Literal

from pydantic import TypeAdapter, ValidationError

from riot_bus.campaign.store import ATTEMPTS
from riot_bus.chain.steps.reproduce import why_untold
from riot_bus.inject.apply import inject_log
from riot_bus.log.foreign import bus_messages, learn_types
from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase, Verdict
from riot_bus_fleet.logs.stores import copied

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.chain.base.workspace import Workspace
    from riot_bus.vocabulary.message import Message
    from riot_bus_fleet.logs.entry import LogEntry
    from riot_bus_fleet.testcases import CaseTemplate

_LOG = logging.getLogger(__name__)
_LARGEST = 1 << 29  # 512 MiB: each of the --jobs logs tried at once is held in memory


@dataclass(frozen=True, slots=True)
class LogAnswer:
    """What a test case did on one log.

    Attributes:
        answer: `fixed`: no trial failed. `failed`: at least one did. `error`: no verdict was possible.
        failed: Trials that failed as the test case says, or in any way if it does not say.
    """

    place: str
    answer: Literal["fixed", "failed", "error"]
    detail: str = ""
    failed: int = 0
    trials: int = 0
    injected: int = 0
    messages: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOptions:
    """How each log is tried."""

    times: int = 1
    start: float = 0.0
    duration: float | None = None
    again: bool = False


def run_over(
    workspace: Workspace, template: CaseTemplate, unit: str, logs: Sequence[LogEntry], options: FleetOptions
) -> list[LogAnswer]:
    """Replay a test case over logs, several at once.

    Answers are kept in the output folder, so a second run continues the first. Logs without a verdict are tried again.
    """
    store = _Answers(workspace.out / "fleet" / "answers.jsonl")
    scope = [workspace.fingerprint, unit, template.digest(), workspace.seed, options.times, options.start]
    keys = {each.place: store.key([*scope, options.duration, each.place, each.size, each.stamp]) for each in logs}
    known = {} if options.again else {each.place: found for each in logs if (found := store.get(keys[each.place]))}
    fresh = [each for each in logs if each.place not in known]
    work = _Work(workspace, template, unit, options)
    with workspace.step("fleet run") as step:
        if fresh:
            work.prepare()
        began = time.monotonic()
        untried: SimpleQueue[LogEntry] = SimpleQueue()  # a signal that raises never leaves it locked, unlike futures
        for each in fresh:
            untried.put(each)
        answers: SimpleQueue[LogAnswer | BaseException] = SimpleQueue()
        count = min(workspace.jobs, len(fresh))
        threads = [
            threading.Thread(target=work.answer_all, args=(untried, answers), name="riot-fleet", daemon=True)
            for _ in range(count)
        ]
        try:
            for thread in threads:
                thread.start()
            for done in range(1, len(fresh) + 1):
                answer = answers.get()
                if isinstance(answer, BaseException):
                    raise answer
                known[answer.place] = answer
                if answer.answer != "error":
                    store.put(keys[answer.place], answer)
                step.progress(done, len(fresh), f"{answer.answer} {answer.place[-50:]}")
        finally:
            work.stop()
            for thread in threads:
                if thread.ident is not None:
                    thread.join()
        step.end(f"{len(logs)} logs, {len(fresh)} of them now, in {time.monotonic() - began:.1f} s")
    return [known[each.place] for each in logs]


def exit_code(answers: Sequence[LogAnswer]) -> int:
    """Return 1 if the test case still fails on some log, else 4 if some log has no verdict, else 0."""
    kinds = {each.answer for each in answers}
    return 1 if "failed" in kinds else 4 if "error" in kinds else 0


class _Work:
    """Tries logs on several threads at once."""

    def __init__(self, workspace: Workspace, template: CaseTemplate, unit: str, options: FleetOptions) -> None:
        file = workspace.context.file
        self._workspace, self._template, self._unit, self._options = workspace, template, unit, options
        self._inputs = file.components[file.component_of(unit)].inputs
        self._learning = threading.Lock()
        self._stopping = threading.Event()
        self._runner: Runner
        self._untold = ""

    def prepare(self) -> None:
        """Make the runner, and find out whether trials can show the failure."""
        nominal = self._workspace.known_unit_log(self._unit)
        self._runner = self._workspace.runners.unit(self._unit, lambda: nominal)
        if signature := self._template.signature:
            monitor = signature.partition(" ")[0]
            self._untold = why_untold(
                self._workspace, unit=self._unit, monitor=monitor, signature=signature, nominal=nominal
            )

    def stop(self) -> None:
        """Make all threads end after their present trial."""
        self._stopping.set()

    def answer_all(self, untried: SimpleQueue[LogEntry], answers: SimpleQueue[LogAnswer | BaseException]) -> None:
        """Try logs until none are left or it is stopped; any other exception is put among the answers."""
        try:
            while not self._stopping.is_set():
                answers.put(self.answer(untried.get_nowait()))
        except Empty:
            pass
        except BaseException as error:
            answers.put(error)

    def answer(self, log: LogEntry) -> LogAnswer:
        """Try one log; an error is an answer, too."""
        try:
            with copied(log.place) as path:
                messages, damage = self._read(path)
            return self._try(log.place, messages, damage)
        except Exception as error:
            if not isinstance(error, RiotError):
                _LOG.exception("a log could not be tried")
                return LogAnswer(log.place, "error", f"riot_bus itself failed: {error!r}")
            where = f"{error.where}: " if error.where and error.where != log.place else ""
            return LogAnswer(log.place, "error", f"{where}{error.message}")

    def _read(self, path: Path) -> tuple[list[Message], str]:
        registry = self._workspace.context.registry
        with LogReader(path) as reader:
            with self._learning:
                learn_types(reader, registry)
            low = high = None
            if self._options.start or self._options.duration is not None:
                first = next(reader.messages(), None)
                begin = first.time if first is not None else 0
                low = begin + int(self._options.start * 1e9)
                high = None if self._options.duration is None else low + int(self._options.duration * 1e9)
            found, size = [], 0
            for message in bus_messages(reader, registry, start=low, end=high):
                if not any(registry.matches(topic, message.key) for topic in self._inputs):
                    continue
                size += len(message.payload)
                if size > _LARGEST:
                    text = f"it holds more than {_LARGEST >> 20} MiB for {self._unit!r}"
                    raise ConfigError(text, hint="try a part of it: --duration SECONDS")
                found.append(message)
            return found, str(reader.loss) if reader.loss else ""

    def _try(self, place: str, messages: Sequence[Message], damage: str) -> LogAnswer:
        if not messages:
            inputs = ", ".join(self._inputs) or "none declared"
            return LogAnswer(place, "error", f"it holds nothing on the inputs of {self._unit!r} ({inputs})")
        seed, injections = self._workspace.seed, self._template.injections
        _, touched = inject_log(messages, injections, registry=self._workspace.context.registry, seed=seed)
        if not touched:
            detail = "the test case changes nothing in it: its messages, numbers or times do not occur (--anywhere?)"
            return LogAnswer(place, "error", detail, messages=len(messages))
        outcomes = [
            self._execute(TestCase(tuple(messages), injections, seed + number)) for number in range(self._options.times)
        ]
        figures = {"trials": len(outcomes), "injected": len(touched), "messages": len(messages)}
        for each in outcomes:
            if not each.judged:
                return LogAnswer(place, "error", each.detail, **figures)
        signature = self._template.signature
        alike = [each for each in outcomes if each.failed_as(signature)]
        others = [each for each in outcomes if each.verdict is Verdict.FAIL and not each.failed_as(signature)]
        notes = [f"the log is damaged: {damage}"] if damage else []
        if others:
            notes.insert(0, f"fails in another way: {others[0].violations[0].signature}")
        if alike:
            shown = (signature and alike[0].violation_as(signature)) or alike[0].violations[0]
            notes.insert(0, shown.detail or shown.signature)
        failed = len(alike)
        if self._untold and not alike and not others:
            return LogAnswer(place, "error", f"nothing here shows whether it fails: {self._untold}", **figures)
        return LogAnswer(place, "failed" if alike or others else "fixed", "; ".join(notes), failed, **figures)

    def _execute(self, case: TestCase) -> Outcome:
        for _ in range(ATTEMPTS):
            if self._stopping.is_set():
                raise KeyboardInterrupt
            (outcome,) = self._runner.run([case])
            if outcome.verdict is not Verdict.ERROR:
                break
        return outcome


class _Answers:
    """Answers by a hash of everything that determines them, in an append-only file of JSON lines."""

    _ADAPTER = TypeAdapter(LogAnswer)

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, dict[str, Any]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        data = path.read_bytes() if path.exists() else b""
        for line in data.splitlines():
            try:
                record = json.loads(line)
                self._known[str(record["key"])] = dict(record["answer"])
            except (ValueError, KeyError, TypeError):
                continue  # the process was killed while writing it
        if data and not data.endswith(b"\n"):
            with path.open("ab") as stream:
                stream.write(b"\n")

    @staticmethod
    def key(parts: Sequence[object]) -> str:
        return hashlib.sha256(json.dumps(parts, default=repr).encode()).hexdigest()[:32]

    def get(self, key: str) -> LogAnswer | None:
        try:
            return self._ADAPTER.validate_python(self._known[key])
        except (KeyError, ValidationError):
            return None

    def put(self, key: str, answer: LogAnswer) -> None:
        row = asdict(answer)
        self._known[key] = row
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"key": key, "answer": row}, separators=(",", ":")) + "\n")
