"""A repository whose only unit is the drive of the machine: its versions, what it knows, and what `riot ci` sees."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from riot_bus.chain.base.workspace import Workspace
from riot_bus.ci.ci import CiPlan, CiResult, UnitResult, run_ci
from riot_bus.ci.ci_baseline import accept
from riot_bus.events import RunEvent
from riot_bus.findings.known import KnownFindings
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import SYSTEM, Machine, hangs, said

CHANGE = CiPlan(60.0, stop_early=True, explain=False, trials=40)


def slow(messages: Sequence[Message]) -> int | None:
    """Return the first command with a speed below minus a thousand: a drive with most of the fault mended."""
    for place, message in enumerate(messages):
        try:
            speed = said(message).get("speed")
        except ValueError:
            continue
        if isinstance(speed, int | float) and speed < -1000:
            return place
    return None


@dataclass
class Repository:
    """A folder with riot.toml and a baseline."""

    folder: Path
    version: int = 0
    events: list[RunEvent] = field(default_factory=list)
    machine: dict[str, Any] = field(default_factory=dict)
    fault: str = ""

    def __post_init__(self) -> None:
        self.commit()

    def commit(self, fails: Callable[[Sequence[Message]], int | None] = hangs, **machine: Any) -> None:
        """Make another version, whose drive fails so."""
        self.version += 1
        self.machine = {"fails": fails, **machine}
        (self.folder / "riot.toml").write_text(f"{SYSTEM}\n[components.version{self.version}]\ncommand = ['x']\n")

    @property
    def out(self) -> Path:
        return self.folder / "riot-out"

    @property
    def drive(self) -> Path:
        """The output folder of the only unit."""
        return self.out / "drive"

    @property
    def known(self) -> KnownFindings:
        return KnownFindings.load(self.folder / "riot-baseline.json")

    @contextmanager
    def opened(self, unit: str, folder: Path) -> Iterator[Workspace]:
        if self.fault:
            raise EnvironmentFaultError(self.fault)
        machine = Machine(self.folder, **self.machine)
        with Workspace(self.folder / "riot.toml", folder, listeners=[self.events.append], runners=machine) as workspace:
            yield workspace

    def change(self, plan: CiPlan = CHANGE, **more: Any) -> CiResult:
        return run_ci(["drive"], self.opened, out=self.out, known=self.known, plan=plan, **more)

    def one(self, plan: CiPlan = CHANGE) -> UnitResult:
        (unit,) = self.change(plan).units
        return unit

    def accept(self, *folders: Path, **more: Any) -> list[str]:
        """Make findings known."""
        known, lines = accept(self.known, folders, since="2026-03-01", **more)
        known.save()
        return lines

    def mark_fixed(self) -> None:
        """Say that all that is known is fixed."""
        fixed = [one.model_copy(update={"fixed": "2026-03-02"}) for one in self.known.entries.values()]
        self.known.updated(fixed).save()

    def standings(self, unit: UnitResult) -> dict[str, str]:
        """Return what there is of this version, by signature."""
        return {one.finding.signature: unit.view.standing(one) for one in unit.view.current}
