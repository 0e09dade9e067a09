"""A finding stays the same when its code is edited, renamed or built anew, and reproduce tells when it is mended."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.findings.records import FindingRecord
from tests.systems.misbehaviour.catalogue import FAULTY, build, missing, write
from tests.tiers import chosen

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

LINES = 50
FAULT = "def misbehave(command):\n"


def riot(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "riot_bus", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def rewrite(folder: Path, *, name: str, above: str = "", inside: str = "") -> None:
    """Rename the unit's program, and insert lines above and inside the function that fails."""
    old = next(folder.glob("node*.py"))
    system = folder / "riot.toml"
    system.write_text(system.read_text().replace(old.name, name))
    old.rename(folder / name).write_text((folder / name).read_text().replace(FAULT, above + FAULT + inside))


@pytest.mark.parametrize("kind", chosen(("raises", "faults_in_libc"), gate=("raises",)))
def test_an_edited_renamed_and_rebuilt_unit_has_the_same_finding_until_it_is_mended(tmp_path: Path, kind: str) -> None:
    if missing(kind):
        pytest.skip(f"NOT TESTED: native faults: there is no {missing(kind)}")
    wanted = FAULTY[kind]
    write(tmp_path)
    build(tmp_path, kind)
    test = ("test", f"--unit={kind}", "--trials=16", "--seed=1")
    assert riot(tmp_path, *test).returncode == 1
    findings = sorted((tmp_path / "riot-out/findings").iterdir())
    signatures = {FindingRecord.load(each).signature for each in findings}
    assert signatures <= {each.format(kind) for each in (wanted if isinstance(wanted, tuple) else (wanted,))}

    rewrite(tmp_path, name="node_two.py", above="".join(f"spare_{n} = {n}\n" for n in range(LINES)))
    build(tmp_path, kind, above="".join(f"long spare_{n}(long x) {{ return x + {n}; }}\n" for n in range(LINES)))
    done = riot(tmp_path, "reproduce", str(findings[0]))
    assert (done.returncode, "still failing" in done.stdout) == (1, True), done.stdout + done.stderr
    assert riot(tmp_path, *test).returncode == 1
    assert sorted((tmp_path / "riot-out/findings").iterdir()) == findings

    rewrite(tmp_path, name="node_three.py", inside="    return False\n")
    done = riot(tmp_path, "reproduce", str(findings[0]))
    assert (done.returncode, "fixed" in done.stdout) == (0, True), done.stdout + done.stderr
