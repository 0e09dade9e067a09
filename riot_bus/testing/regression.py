"""The check in the pytest file of a finding: does the failure still occur?"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from riot_bus.chain.base.systems import system_of
from riot_bus.chain.base.workspace import NOMINAL, Workspace
from riot_bus.chain.steps.reproduce import Reproduction, reproduce
from riot_bus.findings.records import FindingRecord
from riot_bus.pool.runners import RunnerFactory


def reproduce_finding(
    folder: Path,
    *,
    system: Path | None = None,
    root: Path = Path(),
    trials: int | None = None,
    runners: RunnerFactory | None = None,
) -> Reproduction:
    """Play the shortest failing log of a finding to fresh components, and leave nothing behind.

    Args:
        folder: Folder of the finding.
        system: Path of riot.toml; by default `RIOT_SYSTEM` of the environment, else see `chain.base.systems.system_of`.
        root: Folder of the project.
        trials: Number of fresh trials; None for as many as needed.
        runners: Factory of the runners; by default, processes on this machine.

    Raises:
        InconclusiveError: The trials do not decide, or show another failure.
        ConfigError: There is no riot.toml of this project, or no log.
        EnvironmentFaultError: The components do not start.
    """
    record = FindingRecord.load(folder)
    variable = os.environ.get("RIOT_SYSTEM")
    file = system_of(record.system_file, folder, named=system or (Path(variable) if variable else None), root=root)
    with tempfile.TemporaryDirectory(prefix="riot-") as name:
        out = Path(name)
        nominal = folder.resolve().parent.parent / NOMINAL
        if nominal.is_file():  # some failures, such as silence, are only recognised with it
            shutil.copyfile(nominal, out / NOMINAL)
        with Workspace(file, out, seed=record.seed, runners=runners, fresh=True) as workspace:
            return reproduce(workspace, folder, times=trials)
