"""Conformance tests for steps of the chain (`riot step NAME`), for their authors to inherit.

    class TestMine(StepConformance):
        step = MINE

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from riot_bus.chain.base.workspace import Workspace
from riot_bus.findings.records import Artefact, FindingRecord, MinimalRecord
from riot_bus.findings.steps import STEPS, ChainStep, find_step
from riot_bus.log.writer import LogWriter
from riot_bus.trial.baseline import UNKNOWN, Baseline
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

_SYSTEM = """
[components.unit]
command = ["true"]
inputs = ["in"]
outputs = ["out"]

[unit.unit]
"""
_SIGNATURE = "crash in unit: unit.py:7"


class FailingRunner:
    """Answers every trial with the same failure, without starting anything; a `RunnerFactory` and its runners."""

    parallelism = 1

    def unit(self, *_: Any, **__: Any) -> FailingRunner:
        """Return a runner for trials of a unit."""
        return self

    def system(self, *_: Any, **__: Any) -> FailingRunner:
        """Return a runner for runs of the whole system."""
        return self

    def baseline(self, *_: Any) -> Baseline:
        """Return the unknown baseline without playing anything."""
        return UNKNOWN

    def in_system(self, *_: Any) -> Baseline:
        """Return the unknown baseline without running anything."""
        return UNKNOWN

    def keep_evidence(self, *_: Any, **__: Any) -> bool:
        """Keep no evidence and return False."""
        return False

    def run(self, cases: Sequence[TestCase]) -> list[Outcome]:
        """Fail all cases."""
        return [Outcome(Verdict.FAIL, (Violation("crash", "unit", _SIGNATURE),)) for _ in cases]

    def close(self) -> None:
        """Do nothing, since nothing was started."""


def write_finding(out: Path) -> Path:
    """Write a finding with its failing and its minimal log, both of JSON messages, and its system file.

    Args:
        out: Folder to write into.

    Returns:
        The folder of the finding.
    """
    (out / "riot.toml").write_text(_SYSTEM, encoding="utf-8")
    folder = out / "riot-out" / "findings" / "unit-crash"
    folder.mkdir(parents=True)
    for name in ("failure", "minimal"):
        with LogWriter(folder / f"{name}.mcap") as writer:
            for number in range(3):
                payload = json.dumps({"x": -number}).encode()
                writer.write(Message(10**9 * (number + 1), "in", payload, encoding="application/json"))
    FindingRecord(
        id=folder.name,
        system="system",
        system_file=str(out / "riot.toml"),
        unit="unit",
        component="unit",
        monitor="crash",
        signature=_SIGNATURE,
        messages=3,
    ).save(folder)
    MinimalRecord(before=3, kept=tuple(range(3)), topics=("in",), one_minimal=False).save(folder)
    return folder


class StepConformance:
    """Tests of a step: its data are complete, it writes one file of its own, and it has a summary of one line.

    It is carried out on a small finding, with a runner that fails every trial.

    Attributes:
        step: The step to which its entry point refers.
        options: Options of its execution.
    """

    step: ClassVar[ChainStep]
    options: ClassVar[Mapping[str, Any]] = {}

    def test_its_data_are_complete(self) -> None:
        """It has names, help, a record with a file of its own, and a function that accepts the options."""
        step = self.step
        assert step.name.isidentifier()
        assert step.title
        assert step.help.endswith(".")
        assert issubclass(step.kind, Artefact)
        assert step.kind.FILE.endswith(".json")
        assert step in STEPS or step.kind.FILE in {f"{step.name}.json"} - {each.kind.FILE for each in STEPS}
        taken = inspect.signature(step.function).parameters
        assert {each.name: each.default for each in step.options}.items() <= {
            name: each.default for name, each in taken.items()
        }.items()

    def test_it_is_found_by_its_name(self) -> None:
        """Its entry point has the step's own name."""
        assert find_step(self.step.name) is self.step

    def test_it_writes_its_record_and_says_what_it_has_come_to(self, tmp_path: Path) -> None:
        """The file exists and can be read again, and the summary is one line."""
        folder = write_finding(tmp_path)
        before = {path.name for path in folder.iterdir()}
        runners: Any = FailingRunner()
        with Workspace(tmp_path / "riot.toml", tmp_path / "riot-out", runners=runners) as workspace:
            record = workspace.carry_out(self.step, folder, **self.options)
        assert self.step.kind.FILE in {path.name for path in folder.iterdir()} - before
        assert self.step.kind.load(folder) == record
        assert record.summary
        assert "\n" not in record.summary
